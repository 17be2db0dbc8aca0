"""Fit many noisy images of one can, and random scenes, and compare with the bound."""

__all__ = ["Config", "run"]

import dataclasses
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
import tyro
from jaxtyping import Bool, Float

import impostor_jax as ij
from experiments.fit_accuracy.bound import bound, error
from experiments.fit_accuracy.scenes import CAMERA, SENSOR, random_scene
from experiments.recording import Metric, check_clean, save_run
from impostor_jax.fit.parameterization import COORDINATES

HERE = Path(__file__).parent

SEED = 0

ANGLES = (90.0, 60.0, 30.0, 10.0)
"""Between the axis and the view, in degrees."""

NOISES = {"1mm": (1e-3, 0.0), "3mm": (3e-3, 0.0), "outliers": (1e-3, 0.1)}
"""Deviation in meters, and part of the readings drawn from 0.3 to 1.5 m."""

DETERMINED = [0, 1, 2, 3, 5]
"""Coordinates that the depths determine in every case: not the ends."""

NORMAL_95 = 1.96
"""Half the width of the 95 percent interval of a normal deviate."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure the accuracy of fits."""

    quick: bool = False
    """Few seeds of one case: a trial of the code, no measurement."""

    seeds: int = 200
    """Images of each case."""

    scenes: int = 200
    """Random scenes."""

    output: Path | None = None
    """Folder of the results; the experiment's own by default, a temporary one with
    --quick."""


def make_can(degrees: float, turn: float = 0.9) -> ij.Cylinder:
    """A can 0.8 m away whose axis makes an angle with the view.

    Args:
        degrees: That angle.
        turn: Angle of the axis in the image, in radians; oblique, so that no edge runs
            along the pixels.
    """
    angle = np.radians(degrees)
    across = np.sin(angle) * np.array([np.cos(turn), np.sin(turn)])
    return ij.Cylinder((0.02, 0.01, 0.8), (*across, np.cos(angle)), 0.04, 0.12)


def noisy_images(
    can: ij.Cylinder, sigma: float, outliers: float, seeds: int
) -> tuple[list[Float[np.ndarray, "h w"]], Bool[np.ndarray, "h w"]]:
    """Images before a wall at 1.2 m, and the true mask."""
    maps = ij.render(can, CAMERA, outputs=("depth", "mask"))
    depth = np.minimum(np.asarray(maps.depth), 1.2)
    images = []
    for seed in range(seeds):
        rng = np.random.default_rng((SEED, seed))
        image = depth + rng.normal(0, sigma, depth.shape)
        wrong = rng.random(depth.shape) < outliers
        image = np.where(wrong, rng.uniform(0.3, 1.5, depth.shape), image)
        images.append(image.astype(np.float32))
    return images, np.asarray(maps.mask)


def case_metrics(
    name: str, can: ij.Cylinder, sigma: float, outliers: float, seeds: int
) -> list[Metric]:
    """Error over the bound, bias and coverage of one case."""
    images, mask = noisy_images(can, sigma, outliers, seeds)
    fits, seconds = timed(lambda image: ij.fit_cylinder(
        image, CAMERA, mask=mask, sigma=sigma), images)  # fmt: skip
    good = [fit for fit in fits if bool(fit.success)]
    errors = np.array([error(fit.cylinder, can) for fit in good])
    variances = np.array([np.diagonal(np.asarray(fit.covariance)) for fit in good])
    covered = np.abs(errors) <= NORMAL_95 * np.sqrt(variances)
    every = bound(can, CAMERA, mask, sigma)
    facing = bound(can, CAMERA, mask, sigma, least_cosine=0.3)
    rms, spread = np.sqrt(np.mean(errors**2, axis=0)), np.std(errors, axis=0)
    n, relative = len(good), 1 / np.sqrt(2 * len(good))
    metrics = [
        Metric(f"{name}.failures", seeds - n, None, "1", "lower", seeds),
        Metric(f"{name}.time", 1e3 * float(np.median(seconds)), None, "ms", "lower", n),
    ]
    for k in DETERMINED:
        ratio = float(rms[k] / every[k])
        without = float(rms[k] / facing[k])
        bias = float(np.mean(errors[:, k]) / spread[k])
        part = float(np.mean(covered[:, k]))
        unit = "rad" if k < 2 else "m"
        label = f"{name}.{COORDINATES[k]}"
        metrics += [
            Metric(f"{label}.rmse", float(rms[k]), float(rms[k]) * relative,
                   unit, "lower", n),
            Metric(f"{label}.over_bound", ratio, ratio * relative, "1", "lower", n),
            Metric(f"{label}.over_bound_of_facing", without, without * relative,
                   "1", "lower", n),
            Metric(f"{label}.bias_over_spread", bias, 1 / np.sqrt(n), "1", "lower", n),
            Metric(f"{label}.coverage_95", part, float(np.sqrt(part * (1 - part) / n)),
                   "1", "higher", n),
        ]  # fmt: skip
    return metrics


def timed(
    fit: Callable[[Float[np.ndarray, "h w"]], ij.FitResult],
    images: list[Float[np.ndarray, "h w"]],
) -> tuple[list[ij.FitResult], list[float]]:
    """Fits of all images, and the seconds that each takes once it is compiled."""
    jax.block_until_ready(fit(images[0]).rms)
    fits, seconds = [], []
    for image in images:
        start = time.perf_counter()
        fits.append(jax.block_until_ready(fit(image)))
        seconds.append(time.perf_counter() - start)
    return fits, seconds


def height_metrics(seeds: int) -> list[Metric]:
    """Height over random poses, with both ends seen and the mask an outline."""
    errors, covered = [], []
    for seed in range(seeds):
        rng = np.random.default_rng((SEED, 1, seed))
        can = make_can(rng.uniform(40, 80), rng.uniform(0.3, 1.2))
        images, mask = noisy_images(can, 1e-3, 0.0, 1)
        fit = ij.fit_cylinder(
            images[0], CAMERA, mask=mask, sigma=1e-3, mask_meaning="outline"
        )
        if bool(fit.success) and fit.height_observed:
            off = float(fit.cylinder.height - can.height)
            errors.append(off)
            covered.append(abs(off) <= NORMAL_95 * float(fit.std.height))
    footprint = 0.8 / 525.0
    n = len(errors)
    rms = float(np.sqrt(np.mean(np.square(errors)))) / footprint
    bias = float(np.mean(errors)) / footprint
    part = float(np.mean(covered))
    return [
        Metric("height.failures", seeds - n, None, "1", "lower", seeds),
        Metric("height.rmse", rms, rms / np.sqrt(2 * n), "pixel", "lower", n),
        Metric("height.bias", bias, rms / np.sqrt(n), "pixel", "lower", n),
        Metric("height.coverage_95", part, None, "1", "higher", n),
    ]


def scene_metrics(count: int) -> list[Metric]:
    """Random scenes, with no start given."""
    within, far = 0, 0
    for seed in range(count):
        scene = random_scene(seed)
        fit = ij.fit_cylinder(scene.depth, CAMERA, mask=scene.mask, sigma=SENSOR)
        if not bool(fit.success):
            continue
        deviation = np.sqrt(np.diagonal(np.asarray(fit.covariance)))
        off = np.abs(error(fit.cylinder, scene.cylinder))
        ratio = np.where(np.isfinite(deviation), off / deviation, 0).max()
        if ratio > 5:
            least = bound(scene.cylinder, CAMERA, scene.mask, scene.sigma)
            least = np.maximum(np.where(np.isfinite(least), least, 0), deviation)
            ratio = np.where(np.isfinite(deviation), off / least, 0).max()
        within += ratio <= 5
        far += ratio > 10
    share = within / count
    return [
        Metric("scenes.within_5", share, float(np.sqrt(share * (1 - share) / count)),
               "1", "higher", count),
        Metric("scenes.false_success", far / count, None, "1", "lower", count),
    ]  # fmt: skip


def run(config: Config) -> Path:
    """Measure and record; returns the folder of the results.

    Raises:
        ValueError: A count is not positive, or the code is not committed.
    """
    for name in ("seeds", "scenes"):
        if getattr(config, name) < 1:
            raise ValueError(f"{name} must be at least 1, got {getattr(config, name)}")
    folder = config.output
    if folder is None:
        folder = Path(tempfile.mkdtemp()) if config.quick else HERE
    angles, noises = ANGLES, NOISES
    if config.quick:
        config = dataclasses.replace(config, seeds=2, scenes=1)
        angles, noises = (60.0,), {"1mm": NOISES["1mm"]}
    else:
        check_clean(folder)
    start = time.perf_counter()
    metrics = [
        metric
        for degrees in angles
        for noise, (sigma, outliers) in noises.items()
        for metric in case_metrics(
            f"{degrees:.0f}deg.{noise}",
            make_can(degrees),
            sigma,
            outliers,
            config.seeds,
        )
    ]
    if not config.quick:
        metrics += height_metrics(config.seeds)
        metrics += scene_metrics(config.scenes)
    save_run(
        folder,
        metrics,
        config,
        seed=SEED,
        dtype=str(make_can(60.0).radius.dtype),
        seconds=time.perf_counter() - start,
        quick=config.quick,
    )
    return folder


if __name__ == "__main__":
    try:
        written = run(tyro.cli(Config))
    except ValueError as problem:
        sys.exit(str(problem))
    print(f"written to {written}")
