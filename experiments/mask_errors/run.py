"""Fit cans with masks that are not theirs, and the cylinders of presets."""

__all__ = ["Config", "measure"]

import dataclasses
import tempfile
import time
from collections.abc import Iterator, Sequence

import numpy as np

from data_synth.generate import generate
from data_synth.presets import PRESETS
from experiments.mask_errors.report import tables
from experiments.mask_errors.scenes import (
    MASKS,
    SCENES,
    TRUE_MASK,
    CanScene,
    clean_view,
)
from experiments.outcomes import counted, coverage, labeled, scaled_errors
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.scenes import CAMERA
from experiments.timing import sample
from impostor_jax.evaluate import Outcome, evaluate
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.io.dataset import read_dataset
from impostor_jax.io.dataset_shard import LabeledImage
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.gaussian import ConstantNoise

NOISE = {"1mm": 1e-3, "3mm": 3e-3}

COMPARED = tuple(name for name in CYLINDER.coordinates if name != "center_along")
"""Of the cans: the place along the axis tells no more than the height."""

FITTED = ("bench", "tabletop_cans", "pipes", "tree_trunks", "inside_pipe", "hard")
"""Presets whose cylinders are fitted."""

COSTLY = "inside_pipe"
"""Preset whose fits have the most readings, and fewer images."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure how far off fits are whose masks are not the object's."""

    run: RunConfig = RunConfig()
    seeds: int = 5
    """Images of each can and noise."""
    images: int = 30
    """Of each preset."""
    images_inside: int = 12
    """Of the preset with the camera in a pipe, whose fits take longest."""
    seed: int = 0
    """Of all draws."""


@dataclasses.dataclass(frozen=True)
class Fitted:
    """A fit, and what it was of.

    Attributes:
        group: Of its scene.
        outcome: How it went.
        milliseconds: What it took.
    """

    group: str
    outcome: Outcome
    milliseconds: float


def measure(config: Config) -> Iterator[Metric]:
    """Fit cans with each mask, then the cylinders of each preset."""
    noises, scenes, masks, presets = NOISE, list(SCENES), list(MASKS), list(FITTED)
    if config.run.quick:
        noises, scenes, masks = {"1mm": 1e-3}, ["table.30deg"], [TRUE_MASK, "+2 px"]
        presets = ["bench"]
    for noise, sigma in noises.items():
        for mask in masks:
            fits: list[Fitted] = []
            for scene in scenes:
                fits += masked(SCENES[scene], sigma, mask, config)
            yield from of_mask(f"{noise}.{mask}", fits)
    for name in presets:
        fits = of_preset(name, config)
        yield from of_fits(f"preset.{name}", fits, CYLINDER.coordinates)


def masked(
    scene: CanScene, sigma: float, mask: str, config: Config
) -> Iterator[Fitted]:
    """Fits of a can with one kind of mask; other masks get the same readings."""
    clean, own = clean_view(scene)
    for seed in range(config.seed, config.seed + config.seeds):
        rng = np.random.default_rng(seed)
        depth = np.where(clean > 0, clean + rng.normal(0, sigma, clean.shape), 0)
        seen = MASKS[mask](own, rng)
        image = labeled(depth.astype(np.float32), seen, CAMERA, scene.can, seed)
        yield from _fits(scene.group, image, ConstantNoise(sigma))


def of_preset(name: str, config: Config) -> list[Fitted]:
    """Fits of the cylinders of a dataset, each with the mask of its visible part."""
    count = config.images_inside if name == COSTLY else config.images
    fits: list[Fitted] = []
    with tempfile.TemporaryDirectory() as home:
        generate(name, count, home, config.seed, clean=False, workers=1)
        for image in read_dataset(home):
            fits += _fits(name, image, PRESETS[name].sensor)
    return fits


def _fits(
    group: str, image: LabeledImage, sensor: AbstractDepthNoise
) -> Iterator[Fitted]:
    started = time.perf_counter()
    (outcomes,) = evaluate([image], sensor)
    seconds = time.perf_counter() - started
    for outcome in outcomes:
        yield Fitted(group, outcome, 1e3 * seconds / len(outcomes))


def of_mask(label: str, fits: Sequence[Fitted]) -> Iterator[Metric]:
    """What fits with one kind of mask have in common, and those of each group."""
    yield from of_fits(f"{label}.all", fits, COMPARED)
    for group in dict.fromkeys(fit.group for fit in fits):
        own = [fit for fit in fits if fit.group == group]
        yield from of_fits(f"{label}.{group}", own, COMPARED)


def of_fits(
    label: str, fits: Sequence[Fitted], names: Sequence[str]
) -> Iterator[Metric]:
    """What is told of all experiments, failures, the largest error and times.

    The spread of a time is the range of its middle half.
    """
    outcomes = [fit.outcome for fit in fits]
    yield from counted(label, outcomes, names)
    yield coverage(f"{label}.coverage_95", outcomes, names)
    largest = [float(np.max(np.abs(x))) for x in scaled_errors(outcomes, names)]
    n, good = len(fits), len(largest)
    yield Metric(f"{label}.failures", n - good, None, "fits", "lower", n)
    most = max(largest, default=None)
    yield Metric(f"{label}.largest", most, None, "deviations", "lower", good)
    yield sample(f"{label}.time", [fit.milliseconds for fit in fits], "ms")


if __name__ == "__main__":
    main(Config, measure, tables, Config(seeds=1, images=1, images_inside=1))
