"""Time renders and their gradients, beside C and other programs that do the same.

What is compared is timed in turns, a block of calls each, so that all meet the machine
in one state and their ratios are fair. Before that, all must draw the same image.
"""

__all__ = ["Config", "measure"]

import contextlib
import dataclasses
import gc
import math
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from experiments.recording import Metric
from experiments.render_speed.kernel import compile_kernel
from experiments.render_speed.names import FIRST, GROUPS, RATIOS
from experiments.render_speed.report import draw, tables
from experiments.render_speed.scaling import measure_scaling
from experiments.render_speed.workloads import (
    Calls,
    Tools,
    can_calls,
    scene_calls,
)
from experiments.running import RunConfig, main
from experiments.scenes import make_view
from experiments.timing import (
    Timing,
    case_metrics,
    first_calls,
    in_new_process,
    sample,
    time_in_turns,
)
from impostor_jax.glsl.offscreen import DriverError, OffscreenRenderer

SEED = 0

PROCESSES = 3
"""New processes of each kind in which a first call is timed."""

SHRINK = 4
"""How many times coarser the pixels of a quick run are."""

FEW = 4
"""Cylinders of every scene of a quick run, for which one program is compiled."""

FIRST_UNITS = {"call": "ms", "import": "ms", "arguments": "ms", "memory": "MB"}
"""What is told of a first call."""

FIRST_CALL = "experiments.render_speed.first_call"


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure how long renders and gradients take, beside other programs."""

    run: RunConfig = RunConfig()
    repeats: int = 200
    """Timed calls of a case of the can; slower cases take a share of them."""


def measure(config: Config) -> Iterator[Metric]:
    """Measure all cases, ratios, curves and first calls."""
    shrink = SHRINK if config.run.quick else 1
    camera = make_view(640 // shrink, 480 // shrink)
    timings: dict[str, Timing] = {}
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        renderer = None
        with contextlib.suppress(DriverError):
            renderer = stack.enter_context(OffscreenRenderer())
        tools = Tools(compile_kernel(Path(folder)), renderer)

        def calls_of(group: str) -> Calls:
            if group == "can640":
                return can_calls(camera, tools, loss=True)
            if group == "can1920":
                large = camera if config.run.quick else make_view(1920, 1080)
                return can_calls(large, tools, loss=False)
            count = int(group.removeprefix("scene"))
            mixed = "mixed" in GROUPS[group].labels and not config.run.quick
            count = FEW if config.run.quick else count
            return scene_calls(count, SEED, camera, tools, mixed)

        for name, group in GROUPS.items():
            # Mitsuba looks through the shapes of all scenes that are still there:
            # one of 1000 makes the can's 80 times slower.
            gc.collect()
            repeats = math.ceil(group.share * config.repeats)
            found = time_in_turns(calls_of(name), repeats, group.warm_up)
            for case in group.labels:
                yield from case_metrics(f"{name}.{case}", found.get(case))
            timings |= {f"{name}.{case}": timing for case, timing in found.items()}
        yield from measure_scaling(
            camera, tools.kernel, config.repeats, quick=config.run.quick
        )
    yield from ratios(timings)
    yield from measure_first_calls(config)


def ratios(timings: dict[str, Timing]) -> Iterator[Metric]:
    """Ratios of two cases' medians, block by block, and of their minima."""
    for name, ratio in RATIOS.items():
        values, least = np.zeros(0), None
        if ratio.top in timings and ratio.bottom in timings:
            top, bottom = timings[ratio.top].ms, timings[ratio.bottom].ms
            # Two groups may have different numbers of blocks, with few repeats.
            n = min(len(top), len(bottom))
            medians = (np.median(ms[:n], axis=1) for ms in (top, bottom))
            values = np.divide(*medians) / ratio.scale
            least = float(top.min() / bottom.min() / ratio.scale)
        yield sample(f"ratio.{name}", values, "1")
        label = f"ratio.{name}.of_minima"
        yield Metric(label, least, None, "1", "lower", values.size)


def measure_first_calls(config: Config) -> Iterator[Metric]:
    """Time the first render of new processes, in pairs that share a cache."""
    arguments = [str(SHRINK if config.run.quick else 1)]
    records: dict[str, list[dict[str, float | None]]] = {kind: [] for kind in FIRST}
    for _ in range(1 if config.run.quick else PROCESSES):
        with tempfile.TemporaryDirectory() as cache:
            for found in records.values():
                found.append(in_new_process(FIRST_CALL, arguments, Path(cache)))
    for kind, found in records.items():
        yield from first_calls(f"first.{kind}", found, FIRST_UNITS)


if __name__ == "__main__":
    main(Config, measure, tables, Config(repeats=2), draw)
