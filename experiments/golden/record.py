"""What a fit says, kept in few digits, and how far two fits are apart."""

__all__ = ["Entry", "apart", "entry_of", "read", "write"]

import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

import impostor_jax as ij
from impostor_jax.io.atomic import write_text

Entry: TypeAlias = dict[str, Any]
"""Of one fit: its status, estimate and standard deviations by name, number of starts,
and the time of its second call in milliseconds."""

DIGITS = 9
"""Of the estimates: what single precision holds."""


def entry_of(fit: Callable[[], ij.Fit]) -> Entry:
    """Fit twice, once to compile and once for the time."""
    fit()
    start = time.perf_counter()
    found = fit()
    # The status waits for what is computed.
    status = str(found.status)
    milliseconds = 1e3 * (time.perf_counter() - start)
    values = found.to_dict()
    # Of a direction, in radians.
    deviations = {k.removesuffix("_rad"): std for k, std in values["std"].items()}
    return {
        "status": status,
        "starts": int(found.num_starts),
        "ms": float(f"{milliseconds:.3g}"),
        "estimate": {
            name: _rounded(values[name]) for name in deviations if name in values
        },
        "std": {name: _rounded(value) for name, value in deviations.items()},
    }


def _rounded(value: Any) -> Any:
    """The same in few digits; None is not determined."""
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return value if value is None else float(f"{value:.{DIGITS}g}")


def apart(one: Entry, other: Entry) -> float:
    """Largest difference of two estimates, in standard deviations of the first.

    What is not determined does not count.
    """
    largest = 0.0
    for name, value in one["estimate"].items():
        first, second, std = (
            np.array(x, float).ravel()
            for x in (value, other["estimate"].get(name), one["std"][name])
        )
        if not (np.isfinite(std).all() and np.linalg.norm(std) > 0):
            continue
        off = np.linalg.norm(first - second)
        if name == "axis":
            # Either sign is the same axis.
            off = min(off, np.linalg.norm(first + second))
        largest = max(largest, float(off / np.linalg.norm(std)))
    return largest


def read(path: Path) -> dict[str, Entry]:
    """A record, by the names of its cases; nothing where there is none."""
    return json.loads(path.read_text()) if path.exists() else {}


def write(path: Path, entries: Mapping[str, Entry]) -> None:
    """Write a record, a line a case, so that a difference of two shows the cases."""
    lines = (f"{json.dumps(name)}: {json.dumps(x)}" for name, x in entries.items())
    write_text(path, "{\n" + ",\n".join(lines) + "\n}\n")
