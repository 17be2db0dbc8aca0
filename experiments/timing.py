"""How long calls take: in turns in one process, or as the first of new processes."""

__all__ = [
    "COLUMNS",
    "WARM_UP",
    "Timing",
    "case_metrics",
    "case_row",
    "first_calls",
    "growth",
    "in_new_process",
    "peak_memory_mb",
    "percentiles",
    "sample",
    "time_in_turns",
]

import dataclasses
import json
import math
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np
from jaxtyping import Float

from experiments.markdown import three_digits
from experiments.recording import Metric, Results

BLOCKS = 10
"""Turns that a case gets; its calls are spread over them."""

WARM_UP = 3
"""Calls before each block that do not count: threads of the other case still spin."""

ROOT = Path(__file__).parents[1]


@dataclasses.dataclass(frozen=True)
class Timing:
    """Time of each call of a case, in milliseconds, and its minor page faults."""

    ms: Float[np.ndarray, "block call"]
    page_faults: float | None = None


def time_in_turns(
    calls: Mapping[str, Callable[[], object]], repeats: int, warm_up: int = WARM_UP
) -> dict[str, Timing]:
    """Time calls until their results are ready, a block of each in turn.

    All meet the machine in one state, so that their ratios are fair.
    """
    blocks = min(BLOCKS, repeats)
    shape = (blocks, math.ceil(repeats / blocks))
    ms = {name: np.zeros(shape) for name in calls}
    faults = dict.fromkeys(calls, 0)
    for block in range(blocks):
        for name, call in calls.items():
            for _ in range(warm_up):
                jax.block_until_ready(call())
            faults[name] -= resource.getrusage(resource.RUSAGE_SELF).ru_minflt
            for index in range(shape[1]):
                start = time.perf_counter()
                jax.block_until_ready(call())
                ms[name][block, index] = 1e3 * (time.perf_counter() - start)
            faults[name] += resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    return {name: Timing(ms[name], faults[name] / ms[name].size) for name in calls}


def in_new_process(module: str, arguments: Sequence[str], cache: Path) -> Any:
    """What a module prints, as JSON, in a process of its own.

    Args:
        module: Run with `python -m`.
        arguments: Of its command line.
        cache: Folder of compiled programs, which outlives the process.
    """
    compiled = {
        "JAX_COMPILATION_CACHE_DIR": str(cache),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    }
    done = subprocess.run(
        [sys.executable, "-m", module, *arguments],
        cwd=ROOT,
        env=os.environ | compiled,
        stdout=subprocess.PIPE,
        check=True,
    )
    return json.loads(done.stdout)


def sample(
    name: str, values: Any, unit: str, better: Literal["lower", "higher"] = "lower"
) -> Metric:
    """Median and interquartile range; nothing where nothing was measured."""
    values = np.asarray([value for value in np.ravel(values) if value is not None])
    if not values.size:
        return Metric(name, None, None, unit, better, 0)
    low, middle, high = (float(q) for q in np.percentile(values, (25, 50, 75)))
    return Metric(name, middle, high - low, unit, better, values.size)


def percentiles(
    name: str, values: Float[np.ndarray, " n"], percents: Iterable[float], unit: str
) -> Iterator[Metric]:
    """Of errors; None where there are none."""
    n = values.size
    for percent in percents:
        value = float(np.percentile(values, percent)) if n else None
        yield Metric(f"{name}.p{percent:g}", value, None, unit, "lower", n)


def case_metrics(case: str, timing: Timing | None) -> list[Metric]:
    """Median, minimum and page faults of a case; None where it could not run."""
    timing = timing or Timing(np.zeros((0, 0)))
    n = timing.ms.size
    least = float(timing.ms.min()) if n else None
    return [
        sample(f"{case}.median", timing.ms, "ms"),
        Metric(f"{case}.minimum", least, None, "ms", "lower", n),
        Metric(f"{case}.page_faults", timing.page_faults, None, "1/call", "lower", n),
    ]


COLUMNS = ("median, ms", "spread, ms", "minimum, ms", "page faults")
"""Of a table of cases."""


def case_row(results: Results, case: str, label: str) -> list[str]:
    """Row of a case; blank where it could not run."""
    others = (results.values.get(f"{case}.{n}") for n in ("minimum", "page_faults"))
    return [label, *map(three_digits, (*results.pair(f"{case}.median"), *others))]


def first_calls(
    label: str, records: Sequence[Mapping[str, Any]], units: Mapping[str, str]
) -> Iterator[Metric]:
    """What processes tell of their first calls, by the part and with its unit."""
    for part, unit in units.items():
        yield sample(f"{label}.{part}", [record[part] for record in records], unit)


def growth(name: str, sizes: Sequence[int], times: Sequence[float]) -> Metric:
    """Slope of the logarithms by least squares, and its standard error.

    None where there are too few sizes.
    """
    n = len(sizes)
    if n < 2:
        return Metric(name, None, None, "1", "lower", n)
    x, y = np.log(sizes), np.log(times)
    x, y = x - x.mean(), y - y.mean()
    slope = float(x @ y / (x @ x))
    rest = y - slope * x
    error = None if n < 3 else float(np.sqrt(rest @ rest / (n - 2) / (x @ x)))
    return Metric(name, slope, error, "1", "lower", n)


def peak_memory_mb() -> float | None:
    """Largest resident memory of this process; None where there is no /proc.

    Not `ru_maxrss`: it outlives the fork and the exec that started this process, and
    would tell the peak of the parent.
    """
    status = Path("/proc/self/status")
    for line in status.read_text().splitlines() if status.exists() else ():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024 / 1e6
    return None
