"""Fit images twice, the second time with other last bits, and compare what is said."""

__all__ = ["Config", "measure"]

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

import impostor_jax as ij
from experiments.errors import error
from experiments.last_bit.images import (
    Image,
    desk,
    drawn,
    moved_by_one_ulp,
    real,
    rounded,
)
from experiments.last_bit.report import tables
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.sensor_models.scenes import SENSORS

ROUNDED = 1e-4
"""Grid of readings, in meters, below the noise of all sensors here."""

FAR = 0.1
"""Standard deviations by which an estimate may move."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure whether the last bit of depths changes what fits say."""

    run: RunConfig = RunConfig()
    images: int = 64
    """Of each camera."""
    moves: int = 5
    """Of each real image."""
    folder: Path | None = None
    """Folder of real images, which are not part of the project."""
    seed: int = 0
    """Of all draws."""


def measure(config: Config) -> Iterator[Metric]:
    """Images of whole cameras, and real ones where a folder of them is given."""
    for sensor in list(SENSORS)[:1] if config.run.quick else SENSORS:
        images = drawn(sensor, config.images, config.seed)
        yield from _compared(f"{sensor}.ulp", images, 1, _moved(config))
    if config.folder is not None:
        images = [*real(config.folder)]
        yield from _compared("real.ulp", images, config.moves, _moved(config))
        yield from _compared("real.rounded", images, 1, lambda x: rounded(x, ROUNDED))
        yield from _searched(desk(config.folder), config.moves, _moved(config))


def _moved(config: Config) -> Callable[[Image], Image]:
    rng = np.random.default_rng(config.seed)
    return lambda image: moved_by_one_ulp(image, rng)


def _compared(
    label: str,
    images: Iterable[Image],
    moves: int,
    change: Callable[[Image], Image],
) -> Iterator[Metric]:
    """Share of the fits that keep their status, and how far their estimates go."""
    kept, moved = [], []
    for image in images:
        fit = image.fit()
        for _ in range(moves):
            other = change(image).fit()
            is_kept = fit.status == other.status
            kept.append(is_kept)
            if not is_kept:
                print(f"{label}: {image.name}: {fit.status} becomes {other.status}")
            elif fit.success:
                moved.append(_moves(fit, other))
                if moved[-1] > FAR:
                    print(f"{label}: {image.name}: by {moved[-1]:.2f} deviations")
    n = len(kept)
    yield Metric.share(f"{label}.kept", float(np.mean(kept)), n)
    far = int(np.sum(np.array(moved) > FAR))
    yield Metric(f"{label}.far", far, None, "fits", "lower", len(moved))
    for name, value in (("median", np.median(moved)), ("largest", np.max(moved))):
        metric = f"{label}.{name}"
        yield Metric(metric, float(value), None, "deviations", "lower", len(moved))


def _searched(
    image: Image, moves: int, change: Callable[[Image], Image]
) -> Iterator[Metric]:
    """Share of the searches that find as many cylinders."""
    first, *others = (
        len(ij.find_cylinders(one.depth, one.camera))
        for one in (image, *(change(image) for _ in range(moves)))
    )
    kept = float(np.mean([other == first for other in others]))
    yield Metric.share("desk, searched.ulp.kept", kept, moves)


def _moves(fit: ij.Fit, other: ij.Fit) -> float:
    """Largest difference of coordinates that are known, in standard deviations."""
    deviations = np.sqrt(np.diagonal(np.asarray(fit.covariance)))
    return float(np.max(np.abs(error(other.cylinder, fit.cylinder)) / deviations))


if __name__ == "__main__":
    main(Config, measure, tables, Config(images=2))
