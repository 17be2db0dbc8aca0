"""Time fits: warm and first, alone and in batches, beside other programs, and growing.

Warm fits that are compared are timed in turns, a block of calls each, so that all meet
the machine in one state and their ratios are fair.
"""

__all__ = ["Config", "measure"]

import dataclasses
import math
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from experiments.fit_speed.cases import (
    VMAPPED,
    View,
    batch_cases,
    see_can,
    single_cases,
    time_fits,
    yardstick,
)
from experiments.fit_speed.peers import peer_metrics
from experiments.fit_speed.report import FIRST, FIRST_PARTS, tables
from experiments.fit_speed.scaling import FEW, MANY, scaling_metrics
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.scenes import SIGMA
from experiments.timing import (
    Timing,
    case_metrics,
    first_calls,
    in_new_process,
    sample,
)

PROCESSES = 3
"""New processes in which a first fit is timed."""

BATCH = 32
"""Images of a batch."""

FIRST_CALL = "experiments.fit_speed.first_call"

QUICK_CASE = "balanced.mask"
"""The one that a quick run times: each effort is 15 s to compile."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure how long fits take."""

    run: RunConfig = RunConfig()
    repeats: int = 60
    """Timed calls of each warm fit; of batches and growing sizes a tenth and a fifth of
    it."""


def single_metrics(view: View, config: Config) -> Iterator[Metric]:
    """Warm fits of one image."""
    calls = single_cases(view)
    if config.run.quick:
        calls = {QUICK_CASE: calls[QUICK_CASE]}
    timings = time_fits(calls, config.repeats, beside={"fft2": yardstick(view)})
    for case, timing in timings.items():
        yield from case_metrics(f"single.{case}", timing)
    blocks = [np.median(timings[case].ms, axis=1) for case in ("balanced.mask", "fft2")]
    yield sample("single.balanced_over_fft2.mask", blocks[0] / blocks[1], "1")
    for kind in ("mask", "no_mask"):
        blocks = [
            np.median(timings[case].ms, axis=1) if case in timings else np.zeros(0)
            for case in (f"fast.{kind}", f"exact.{kind}")
        ]
        yield sample(f"single.fast_over_exact.{kind}", blocks[0] / blocks[1], "1")


def batch_metrics(view: View, config: Config) -> Iterator[Metric]:
    """Fits of many images, per image."""
    calls = batch_cases(view)
    if config.run.quick:
        calls = {QUICK_CASE: calls[QUICK_CASE]}
    repeats = math.ceil(config.repeats / 10)
    for case, timing in time_fits(calls, repeats, warm_up=0).items():
        count = VMAPPED if case == "vmap.mask" else len(view.depths)
        faults = None if timing.page_faults is None else timing.page_faults / count
        yield from case_metrics(f"batch.{case}", Timing(timing.ms / count, faults))


def first_metrics(view: View, scratch: Path) -> Iterator[Metric]:
    """Fits in new processes: with an empty cache, then with the one that this fills."""
    records = {}
    single, batch = scratch / "single.npz", scratch / "batch.npz"
    _save(single, view, view.depths[0], view.mask)
    _save(batch, view, view.depths, np.stack([view.mask] * len(view.depths)))
    for effort in ("balanced", "fast"):
        arguments = [effort, str(single)]
        caches = [scratch / f"{effort}{index}" for index in range(PROCESSES)]
        # The last of these folders is filled then.
        for state, folders in (("empty", caches), ("filled", caches[-1:] * PROCESSES)):
            records[f"{effort}.{state}"] = [
                in_new_process(FIRST_CALL, arguments, folder) for folder in folders
            ]
    filled = scratch / f"balanced{PROCESSES - 1}"
    arguments = ["balanced", str(batch)]
    records["batch.filled"] = [in_new_process(FIRST_CALL, arguments, filled)]
    for case in FIRST:
        yield from first_calls(f"first.{case}", records[case], FIRST_PARTS)


def _save(
    path: Path,
    view: View,
    depth: Float[np.ndarray, "*n h w"],
    mask: Bool[np.ndarray, "*n h w"],
) -> None:
    """Write what `first_call` reads."""
    lens = view.camera
    camera = [lens.fx, lens.fy, lens.cx, lens.cy, lens.width, lens.height]
    np.savez(path, depth=depth, mask=mask, sigma=SIGMA, camera=np.array(camera, float))


def measure(config: Config) -> Iterator[Metric]:
    """Measure all cases; a trial compiles one program and starts no process."""
    sizes = FEW if config.run.quick else MANY
    view = see_can(sizes.scales[0] if config.run.quick else 1.0, max(sizes.images))
    yield from single_metrics(view, config)
    yield from batch_metrics(view.first(BATCH), config)
    yield from scaling_metrics(view, sizes, math.ceil(config.repeats / 5))
    if not config.run.quick:
        yield from peer_metrics(view)
        with tempfile.TemporaryDirectory() as scratch:
            yield from first_metrics(view.first(BATCH), Path(scratch))


if __name__ == "__main__":
    main(Config, measure, tables, Config(repeats=2))
