"""Turn every dial of an effort, and measure time, memory, errors and failures.

Each setting of a fit runs in a process of its own, where it is timed in turns with the
default: the pace of a shared machine changes, but their ratio does not.
"""

__all__ = ["Config", "measure"]

import dataclasses
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np

import impostor_jax as ij
from experiments.fitting import rmse
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.scenes import CAMERA
from experiments.speed_accuracy.report import draw, tables
from experiments.speed_accuracy.scenes import (
    DIFFICULTIES,
    SHAPES,
    Images,
    cans_and_mirror,
    make_images,
)
from experiments.speed_accuracy.settings import (
    FITS,
    MANY,
    PHOTOGRAPHED,
    RENDERS,
    TRACES,
    Traced,
)
from experiments.timing import in_new_process, percentiles, sample, time_in_turns
from impostor_jax.effort import Effort

WRONG = 10.0
"""Reported deviations, and bounds, from which an estimate is wrong and not imprecise;
it is counted, and left out of the errors."""

QUANTITIES = {"axis": (0, 1), "center": (2, 3), "radius": (5,)}
"""Coordinates of `Fit.covariance`; of the center those across the axis."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure what each dial costs and gives."""

    run: RunConfig = RunConfig()
    images: int = 100
    """Of each difficulty."""
    timed: int = 20
    """Of these, how many are timed."""
    repeats: int = 60
    """Timed calls of each render."""
    folder: Path | None = None
    """With the photographs; without it there are none."""


def measure(config: Config) -> Iterator[Metric]:
    """Measure each setting of fits, of renders, and of traced pictures."""
    fits, renders, difficulties = list(FITS), list(RENDERS), list(DIFFICULTIES)
    traces, exact = list(TRACES), MANY
    if config.run.quick:
        fits, renders = ["balanced"], ["balanced", "samples=2"]
        difficulties = ["easy"]
        traces, exact = ["balanced"], TRACES["balanced"]
    with tempfile.TemporaryDirectory() as scratch:
        images = {name: make_images(name, config.images) for name in difficulties}
        for name, drawn in images.items():
            np.savez(Path(scratch) / f"{name}.npz", **vars(drawn))
        for setting in fits:
            yield from fit_metrics(
                setting, images, Path(scratch), config.timed, config.folder
            )
    for shape in SHAPES:
        yield from render_metrics(shape, renders, config.repeats)
    yield from trace_metrics(traces, exact, config.repeats)


def fit_metrics(
    setting: str,
    images: dict[str, Images],
    scratch: Path,
    timed: int,
    folder: Path | None,
) -> Iterator[Metric]:
    """One setting's fits of all images."""
    # What one setting has compiled, the next ones need not.
    own = str(scratch / "compiled")
    cache = Path(os.environ.get("JAX_COMPILATION_CACHE_DIR", own))
    photographs = []
    if folder is not None and setting in PHOTOGRAPHED:
        photographs.append(str(folder.resolve()))
    arguments = [str(scratch), setting, str(timed), *photographs]
    record = in_new_process("experiments.speed_accuracy.fits", arguments, cache)
    yield Metric(f"fit.{setting}.memory", record["memory"], None, "MB", "lower", 1)
    for name, drawn in images.items():
        label, of_one = f"fit.{setting}.{name}", record[name]
        yield from time_metrics(label, of_one)
        yield from error_metrics(label, of_one, drawn)
    for name in photographs:
        label, of_one = f"fit.{setting}.real", record[name]
        yield from time_metrics(label, of_one)
        off = [one for one in of_one["off"] if one is not None]
        count, lost = len(of_one["off"]), len(of_one["off"]) - len(off)
        held = float(np.mean(np.abs(off) < 1.96)) if off else None
        yield Metric(f"{label}.failures", lost / count, None, "part", "lower", count)
        yield Metric(f"{label}.held", held, None, "part", "higher", len(off))


def time_metrics(label: str, record: dict[str, Any]) -> Iterator[Metric]:
    """Times of fits, and their ratios to those with the default."""
    yield sample(f"{label}.time", record["ms"], "ms")
    ratios = np.array(record["ms"]) / np.array(record["default_ms"])
    yield sample(f"{label}.time_over_balanced", ratios, "1")


def error_metrics(
    label: str, record: dict[str, Any], drawn: Images
) -> Iterator[Metric]:
    """Failures, wrong successes, and errors of the others over the bound."""
    good = np.array([e is not None for e in record["errors"]])
    count = len(good)
    errors = np.array([e for e in record["errors"] if e is not None]).reshape(-1, 7)
    spread = np.array([d for d in record["deviations"] if d is not None])
    spread, bounds = spread.reshape(-1, 7), drawn.bounds[good]
    known = np.isfinite(bounds) & (spread < 1e8)
    scale = np.maximum(spread, np.where(known, bounds, 0))
    wrong = np.any(known & (np.abs(errors) > WRONG * scale), axis=1)
    for name, value in (
        ("failures", count - int(good.sum())),
        ("wrong", int(wrong.sum())),
    ):
        yield Metric(f"{label}.{name}", value / count, None, "part", "lower", count)
    for name, columns in QUANTITIES.items():
        place = np.array(columns)
        used = known[:, place].all(axis=1) & ~wrong
        n = int(used.sum())
        # Each in its own bound: those of hard scenes differ by a factor of 100.
        ratio = (errors[used] / np.where(known, bounds, 1)[used])[:, place]
        value = float(np.sqrt(np.mean(ratio**2))) if n else None
        off = None if value is None else value / np.sqrt(2 * ratio.size)
        yield Metric(f"{label}.{name}_over_bound", value, off, "1", "lower", n)
    seen = (spread[:, 6] < 1e8) & ~wrong
    height = np.abs(errors[seen, 6])
    middle = float(1e3 * np.median(height)) if seen.any() else None
    yield Metric(f"{label}.height", middle, None, "mm", "lower", int(seen.sum()))


def render_metrics(shape: str, settings: list[str], repeats: int) -> Iterator[Metric]:
    """All settings' renders of one shape, timed in turns, and their errors."""
    can = SHAPES[shape]()
    maps, covers = ("depth", "normal", "mask"), ("coverage",)

    def render(effort: Effort, outputs: tuple[str, ...]) -> ij.GeometryMaps:
        return ij.render(can, CAMERA, outputs, effort=effort)

    calls: dict[str, Callable[[], object]] = {}
    for name in settings:
        for kind, outputs in (("maps", maps), ("coverage", covers)):
            calls[f"{name}.{kind}"] = lambda e=RENDERS[name], o=outputs: render(e, o)
    timings = time_in_turns(calls, repeats)
    exact = render(RENDERS["exact"], (*maps, *covers))
    for name in settings:
        label, effort = f"render.{name}.{shape}", RENDERS[name]
        for kind in ("maps", "coverage"):
            yield sample(f"{label}.{kind}.time", timings[f"{name}.{kind}"].ms, "ms")
        found = render(effort, (*maps, *covers))
        size = sum(leaf.nbytes for leaf in jax.tree.leaves(found)) / 1e6
        yield Metric(f"{label}.size", size, None, "MB", "lower", 1)
        at = np.s_[:: effort.stride, :: effort.stride]
        depth, true = (np.asarray(m.depth, float) for m in (found, exact))
        both = np.isfinite(depth) & np.isfinite(true[at])
        relative = np.abs(depth[both] - true[at][both]) / true[at][both]
        yield from percentiles(f"{label}.depth", relative, (50, 100), "1")
        area, all_of_it = (np.asarray(m.coverage, float) for m in (found, exact))
        edge = (all_of_it[at] > 0) & (all_of_it[at] < 1)
        yield rmse(f"{label}.coverage.rms", (area - all_of_it[at])[edge], "part")


def trace_metrics(settings: list[str], exact: Traced, repeats: int) -> Iterator[Metric]:
    """Times of a traced picture, in turns, and its errors beside an exact one."""
    lit = cans_and_mirror()

    def picture(how: Traced) -> jax.Array:
        return ij.trace(
            lit.scene, CAMERA, lit.lights, lit.materials, lit.background,
            effort=how.effort, edges=how.edges,
        )  # fmt: skip

    calls: dict[str, Callable[[], object]] = {
        name: lambda how=TRACES[name]: picture(how) for name in settings
    }
    timings = time_in_turns(calls, repeats, warm_up=1)
    true = np.asarray(picture(exact), float)
    for name in settings:
        label, ms = f"trace.{name}", timings[name].ms
        yield sample(f"{label}.time", ms, "ms")
        yield sample(f"{label}.time_over_balanced", ms / timings["balanced"].ms, "1")
        error = np.asarray(picture(TRACES[name]), float) - true
        value = float(np.sqrt(np.mean(error**2)))
        yield Metric(f"{label}.rmse", value, None, "1", "lower", error.size)


if __name__ == "__main__":
    main(Config, measure, tables, Config(images=1, timed=1, repeats=2), draw)
