"""Fits with one setting, in a process of their own; prints JSON.

`python -m experiments.speed_accuracy.fits FOLDER SETTING TIMED [REAL]`, where FOLDER
holds the images as `run` writes them, and TIMED is how many of each difficulty are
timed, in turns with the default setting. REAL is a folder of photographs.
"""

__all__ = ["main"]

import json
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np

import impostor_jax as ij
from experiments.errors import error
from experiments.last_bit.images import REAL, real
from experiments.scenes import CAMERA
from experiments.speed_accuracy.scenes import DIFFICULTIES
from experiments.speed_accuracy.settings import FITS
from experiments.timing import peak_memory_mb
from impostor_jax.effort import Effort

KNOWN_TO = 0.01
"""Part of a radius that a ruler, or a catalogue, knows it to."""


def main() -> None:
    """Fit every image, then time some."""
    folder, setting, timed = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    photographs = sys.argv[4:]
    effort = FITS[setting]
    outcomes = {}
    for name in DIFFICULTIES:
        if not (folder / f"{name}.npz").exists():
            continue
        loaded = np.load(folder / f"{name}.npz")
        outcomes[name] = (loaded, accuracy(name, loaded, effort))
    # Before the default setting needs memory of its own.
    memory = peak_memory_mb()
    record = {}
    for name, (loaded, found) in outcomes.items():
        shown = zip(loaded["depth"][:timed], loaded["mask"][:timed], strict=True)
        calls = [partial(one_fit, name, *one) for one in shown]
        record[name] = found | timing(calls, effort)
    record |= {name: on_photographs(Path(name), effort) for name in photographs}
    print(json.dumps(record | {"memory": memory}))


def accuracy(name: str, loaded: Any, effort: Effort) -> dict[str, Any]:
    """Errors and deviations of every fit; None where it failed."""
    errors, deviations = [], []
    for depth, mask, truth in zip(
        loaded["depth"], loaded["mask"], loaded["truth"], strict=True
    ):
        fit = one_fit(name, depth, mask, effort)
        if not bool(fit.success):
            errors.append(None)
            deviations.append(None)
            continue
        can = ij.Cylinder(truth[:3], truth[3:6], truth[6], truth[7])
        errors.append(error(fit.cylinder, can).tolist())
        spread = np.sqrt(np.diagonal(np.asarray(fit.covariance, float)))
        deviations.append(np.where(np.isfinite(spread), spread, 1e9).tolist())
    return {"errors": errors, "deviations": deviations}


def timing(
    calls: Sequence[Callable[[Effort], object]], effort: Effort
) -> dict[str, list[float]]:
    """Milliseconds of fits, and of those with the default, in turns."""
    ms: dict[str, list[float]] = {"ms": [], "default_ms": []}
    for turn in range(2):
        for call in calls:
            for key, used in (("ms", effort), ("default_ms", FITS["balanced"])):
                start = time.perf_counter()
                call(used)
                # The first turn compiles for all sizes.
                if turn:
                    ms[key].append(1e3 * (time.perf_counter() - start))
    return ms


def on_photographs(folder: Path, effort: Effort) -> dict[str, Any]:
    """Outcomes of fits of photographs, the sensor told and not, and their times.

    Of each the radius less what was measured, in deviations of both; None where the fit
    failed.
    """
    images = list(real(folder))
    off: list[float | None] = []
    for case, image in zip((c for c in REAL for _ in range(2)), images, strict=True):
        fit = image.fit(effort)
        off.append(None)
        if bool(fit.success):
            deviation = np.hypot(float(fit.std.radius), KNOWN_TO * case.radius)
            off[-1] = float((float(fit.cylinder.radius) - case.radius) / deviation)
    return {"off": off} | timing([image.fit for image in images], effort)


def one_fit(name: str, depth: Any, mask: Any, effort: Effort) -> ij.Fit:
    """Fit one image with no start given."""
    sigma = DIFFICULTIES[name][1]
    fit = ij.fit_cylinder(depth, CAMERA, mask, sigma, effort=effort)
    return jax.block_until_ready(fit)


if __name__ == "__main__":
    main()
