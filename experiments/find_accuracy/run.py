"""Find the cylinders of generated images, by programs that are given no masks."""

__all__ = ["Config", "measure", "resampled"]

import dataclasses
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from data_synth.distribution import Fixed
from data_synth.preset import CameraDraw, Preset, Rules
from data_synth.presets import PRESETS
from experiments.find_accuracy.program import MissingProgramError
from experiments.find_accuracy.programs import OURS, PROGRAMS
from experiments.find_accuracy.report import GRID, NAMES, draw, tables
from experiments.find_accuracy.runs import Runs, kept_folder
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.timing import sample
from impostor_jax.caching import keep_compiled
from impostor_jax.evaluate import LEVELS as INTERVALS
from impostor_jax.io.dataset import read_dataset
from impostor_jax.matching import (
    Comparison,
    Detection,
    Score,
    Truth,
    compare,
    score_of,
    truth_of,
)


@dataclasses.dataclass(frozen=True)
class Config:
    """Find cylinders without masks, and count what is right."""

    run: RunConfig = RunConfig()
    count: int = 200
    """Images of each preset."""
    timed: int = 16
    """Images of each preset whose time is measured, with nothing else running."""
    workers: int = 2
    """Processes that make datasets, and that programs run in unless they are timed."""
    presets: tuple[str, ...] = NAMES
    """That are searched: any of these."""
    programs: tuple[str, ...] = tuple(PROGRAMS)
    """That search: any of these."""
    seed: int = 2026
    """Of the datasets; settings were tuned with others."""


def measure(config: Config) -> Iterator[Metric]:
    """Score all programs on all presets, then time them.

    What is found is kept in the user's cache folder: an interrupted run goes on there.
    """
    if config.run.quick:
        with tempfile.TemporaryDirectory() as home:
            yield from _measured(config, Path(home))
    else:
        keep_compiled()
        yield from _measured(config, kept_folder())


def _measured(config: Config, home: Path) -> Iterator[Metric]:
    _check_names("program", config.programs, PROGRAMS)
    _check_names("preset", config.presets, NAMES)
    all_runs = {}
    for name in config.presets:
        preset = _small(PRESETS[name]) if config.run.quick else PRESETS[name]
        all_runs[name] = Runs(preset, config.count, config.seed, home, config.workers)
    programs = list(config.programs)
    pooled: dict[str, list[Comparison]] = {program: [] for program in programs}
    for name, runs in all_runs.items():
        truths = [truth_of(image) for image in read_dataset(runs.dataset)]
        yield _counts(name, truths)
        for program in tuple(programs):
            try:
                found = runs.detections(program)
            except MissingProgramError as missing:
                print(f"{program} is left out: {missing}")
                programs.remove(program)
                continue
            label = f"{program}.{name}"
            compared = [compare(*pair) for pair in zip(truths, found, strict=True)]
            pooled[program] += compared
            yield from _scores(label, compared)
            right = _right(truths, found, compared)
            yield from _errors(label, right)
            if program == OURS:
                yield from _against_masks(label, right, runs.fits_to_masks())
    for program in programs:
        yield from _reliability(program, pooled[program])
    for name, runs in all_runs.items():
        for program in programs:
            seconds = runs.seconds(program, min(config.timed, config.count))
            for column, part in enumerate(("wall", "processor")):
                yield sample(f"{program}.{name}.{part}", seconds[:, column], "s")


def _check_names(kind: str, given: Sequence[str], known: Collection[str]) -> None:
    for name in given:
        if name not in known:
            raise ValueError(f"{kind} must be one of {', '.join(known)}, got {name!r}")


def _small(preset: Preset) -> Preset:
    """Scenes of its kind in small images, which are made and searched fast."""
    camera = CameraDraw(count=1, width=320, height=240, focal=Fixed(260.0))
    return dataclasses.replace(preset, camera=camera, rules=Rules(0.1, 100))


def _counts(name: str, truths: Sequence[Truth]) -> Metric:
    """Cylinders that count, and those in all."""
    counted = sum(np.count_nonzero(truth.counted) for truth in truths)
    n = sum(len(truth.counted) for truth in truths)
    return Metric(f"truths.{name}", float(counted), None, "cylinders", "higher", n)


def _scores(label: str, compared: Sequence[Comparison]) -> Iterator[Metric]:
    """Precision, false detections and calibration; the spread is by resampling."""
    score = score_of(compared)
    others = [_numbers(other) for other in resampled(compared)]
    for name, value in _numbers(score).items():
        spread = float(np.std([other[name] for other in others]))
        better = "higher" if name.startswith("ap.") else "lower"
        known = np.isfinite(value)
        yield Metric(
            f"{label}.{name}",
            float(value) if known else None,
            spread if known and np.isfinite(spread) else None,
            "1/image" if "false" in name else "1",
            better,
            score.num_images,
        )
    if score.num_truths:
        curve = score.curves["standard"]
        for recall in GRID:
            reached = curve.precision[curve.recall >= recall]
            value = float(np.max(reached, initial=0.0))
            name, n = f"{label}.precision.{100 * recall:.0f}", score.num_truths
            yield Metric(name, value, None, "1", "higher", n)


def resampled(compared: Sequence[Comparison], repeats: int = 100) -> list[Score]:
    """Scores of as many images drawn from these with replacement (bootstrap)."""
    rng = np.random.default_rng(0)
    n = len(compared)
    draws = rng.integers(n, size=(repeats, n))
    return [score_of([compared[k] for k in draw]) for draw in draws]


def _reliability(program: str, compared: Sequence[Comparison]) -> Iterator[Metric]:
    """Confidence against what is right, in the images of all presets."""
    told = score_of(compared).calibration
    known = None if np.isnan(told.error) else told.error
    n = int(told.number.sum())
    yield Metric(f"{program}.calibration_error", known, None, "1", "lower", n)
    for k, n in enumerate(told.number.tolist()):
        yield Metric(f"{program}.bin{k}.number", n, None, "detections", "higher", n)
        for part, values in (("confidence", told.confidence), ("right", told.right)):
            value = float(values[k]) if n else None
            yield Metric(f"{program}.bin{k}.{part}", value, None, "1", "higher", n)


def _numbers(score: Score) -> Mapping[str, float]:
    """What is told of a score, by name."""
    numbers = {f"ap.{level}": ap for level, ap in score.average_precision.items()}
    numbers |= {f"false.{level}": f for level, f in score.false_per_image.items()}
    numbers["sure_false"] = score.sure_false_per_image["standard"]
    numbers["calibration_error"] = score.calibration.error
    return numbers


class Right(NamedTuple):
    """A detection that is right at the standard level.

    Attributes:
        image: In which it was found.
        number: Of its cylinder in the image.
        radius: The true one, in meters.
        detection: What was found.
    """

    image: int
    number: int
    radius: float
    detection: Detection


def _right(
    truths: Sequence[Truth],
    found: Sequence[Sequence[Detection]],
    compared: Sequence[Comparison],
) -> list[Right]:
    return [
        Right(image, number, float(truths[image].radius[number]), found[image][k])
        for image, one in enumerate(compared)
        for k, number in enumerate(one.matches["standard"].truth.tolist())
        if number >= 0
    ]


def _errors(label: str, right: Sequence[Right]) -> Iterator[Metric]:
    """How far off right radii are, and whether their intervals hold the true ones."""
    relative = [abs(one.detection.radius / one.radius - 1) for one in right]
    yield sample(f"{label}.radius_error", relative, "1")
    scaled = [_apart(one.detection, one.radius) for one in right]
    yield from _held(f"{label}.interval_95", scaled)


def _against_masks(
    label: str, right: Sequence[Right], fits: Sequence[Sequence[Detection]]
) -> Iterator[Metric]:
    """Right radii beside those of fits to the true masks, in their deviations."""
    masked = [fits[one.image][one.number] for one in right]
    pairs = list(zip(masked, right, strict=True))
    apart = [_apart(fit, one.detection.radius) for fit, one in pairs]
    yield sample(f"{label}.from_mask", [x for x in apart if np.isfinite(x)], "std")
    scaled = [_apart(fit, one.radius) for fit, one in pairs]
    yield from _held(f"{label}.mask_interval_95", scaled)


def _apart(one: Detection, radius: float) -> float:
    """Difference of a radius from another one, in standard deviations of the first."""
    return abs(one.radius - radius) / one.radius_std


def _held(name: str, scaled: Sequence[float]) -> Iterator[Metric]:
    """Share of 95 % intervals that hold, of the programs that tell deviations."""
    told = np.array([value for value in scaled if not np.isnan(value)])
    if len(told):
        held = float(np.mean(told < INTERVALS["95 %"]))
        yield Metric.share(name, held, len(told))


if __name__ == "__main__":
    trial = Config(
        count=2, timed=1, workers=1, presets=NAMES[:1], programs=(OURS,), seed=1
    )
    main(Config, measure, tables, trial, draw)
