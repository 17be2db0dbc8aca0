"""Fit cans in images that were made smaller, enlarged or smoothed."""

__all__ = ["Config", "measure"]

import dataclasses
import warnings
from collections.abc import Callable, Iterator
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float

import impostor_jax as ij
from experiments.averaged_images.report import tables
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.scenes import CAMERA, SIGMA

WRONG = 5.0
"""Deviations beyond which a success is wrong."""


class Image(NamedTuple):
    """Depth in meters, whether a pixel is mostly the can's, and the camera."""

    depth: Float[np.ndarray, "h w"]
    mask: Bool[np.ndarray, "h w"]
    camera: ij.PinholeCamera


def resized(image: Image, factor: float, way: int) -> Image:
    """An image of another size."""
    size = tuple(round(factor * side) for side in image.depth.shape[::-1])
    camera = image.camera
    x, y = (new / old for new, old in zip(size, image.depth.shape[::-1], strict=True))
    share = cv2.resize(image.mask.astype(np.float32), size, interpolation=way)
    return Image(
        cv2.resize(image.depth, size, interpolation=way),
        share >= 0.5,
        ij.PinholeCamera(
            camera.fx * x,
            camera.fy * y,
            (camera.cx + 0.5) * x - 0.5,
            (camera.cy + 0.5) * y - 0.5,
            *size,
        ),
    )


class Change(NamedTuple):
    """What is done to an image, and the deviation of its readings then, in meters."""

    made: Callable[[Image], Image]
    sigma: float


def thinned(image: Image) -> Image:
    """Every other pixel along rows and columns."""
    depth, mask = (part[::2, ::2] for part in image[:2])
    numbers = [getattr(image.camera, name) / 2 for name in ("fx", "fy", "cx", "cy")]
    return Image(depth, mask, ij.PinholeCamera(*numbers, *depth.shape[::-1]))


def smoothed(image: Image) -> Image:
    """The mean over 3x3 pixels."""
    return image._replace(depth=cv2.blur(image.depth, (3, 3)))


CHANGES = {
    "none": Change(lambda image: image, SIGMA),
    "every other pixel": Change(thinned, SIGMA),
    "half, averaged": Change(
        lambda image: resized(image, 1 / 2, cv2.INTER_AREA), SIGMA / 2
    ),
    "a quarter, averaged": Change(
        lambda image: resized(image, 1 / 4, cv2.INTER_AREA), SIGMA / 4
    ),
    "0.7 times, averaged": Change(
        lambda image: resized(image, 0.7, cv2.INTER_AREA), SIGMA
    ),
    "twice, interpolated": Change(
        lambda image: resized(image, 2, cv2.INTER_LINEAR), SIGMA
    ),
    "3x3 means": Change(smoothed, SIGMA),
}


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure how far off fits are to images that mix neighboring readings."""

    run: RunConfig = RunConfig()
    count: int = 40
    """Cans, the same for all changes."""
    seed: int = 0
    """Of all draws."""


class Answer(NamedTuple):
    """What a fit says, or None for what it does not.

    Attributes:
        success: Whether it says that it is right.
        radius: Error of the radius, in standard deviations.
        largest: Of radius, axis and height, the largest.
        relative: Standard deviation of the radius, over that.
        has_height: Whether it says a height.
    """

    success: bool
    radius: float = 0.0
    largest: float = 0.0
    relative: float = np.inf
    has_height: bool = False


def measure(config: Config) -> Iterator[Metric]:
    """Fit the same cans after each change."""
    changes = dict(list(CHANGES.items())[: 3 if config.run.quick else None])
    found: dict[str, list[Answer]] = {name: [] for name in changes}
    for seed in range(config.seed, config.seed + config.count):
        can, image = drawn(np.random.default_rng(seed))
        for name, change in changes.items():
            found[name].append(answer_to(change.made(image), change.sigma, can))
    for name, answers in found.items():
        yield from told(name, answers)


def drawn(rng: np.random.Generator) -> tuple[ij.Cylinder, Image]:
    """A can before a wall, each reading of one ray, with white noise."""
    radius, far = rng.uniform(0.025, 0.06), rng.uniform(0.5, 1.2)
    center = far * np.array([rng.uniform(-0.25, 0.25), rng.uniform(-0.2, 0.2), 1])
    axis = np.array([0.0, 0.0, 1.0])
    while abs(axis @ center) > 0.75 * np.linalg.norm(center):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
    can = ij.Cylinder(center, axis, radius, radius * rng.uniform(2, 4))
    wall = ij.Plane((0.0, 0.0, 1.8), (0.1, 0.05, -1.0))
    maps = ij.render(ij.Scene([can, wall]), CAMERA, outputs=("depth", "index"))
    depth = np.asarray(maps.depth, float)
    depth = depth + rng.normal(0, SIGMA, depth.shape)
    return can, Image(depth.astype(np.float32), np.asarray(maps.index) == 0, CAMERA)


def answer_to(image: Image, sigma: float, can: ij.Cylinder) -> Answer:
    """Fit a cylinder to the can's pixels, told the noise of one."""
    with warnings.catch_warnings():
        # Of outlines that lie beside the fit's.
        warnings.simplefilter("ignore", UserWarning)
        fit = ij.fit_cylinder(image.depth, image.camera, image.mask, sigma)
    if not bool(fit.success):
        return Answer(False)
    radius = float((fit.cylinder.radius - can.radius) / fit.std.radius)
    sine = np.linalg.norm(np.cross(np.asarray(fit.cylinder.axis), can.axis))
    turn = float(np.arcsin(min(sine, 1)) / np.linalg.norm(fit.std.axis))
    height = 0.0
    if bool(fit.height_observed):
        height = float((fit.cylinder.height - can.height) / fit.std.height)
    return Answer(
        success=True,
        radius=radius,
        largest=max(abs(radius), turn, abs(height)),
        relative=float(fit.std.radius / can.radius),
        has_height=bool(fit.height_observed),
    )


def told(name: str, found: list[Answer]) -> Iterator[Metric]:
    """What the answers after one change have in common."""
    n, good = len(found), [answer for answer in found if answer.success]
    yield Metric.share(f"{name}.success", len(good) / n, n)
    wrong = sum(answer.largest > WRONG for answer in good)
    yield Metric.share(f"{name}.wrong", wrong / n, n, "lower")
    heights = sum(answer.has_height for answer in good)
    yield Metric.share(f"{name}.heights", heights / n, n)
    if good:
        off = np.array([answer.radius for answer in good])
        spread = float(np.std(off) / len(off) ** 0.5)
        yield Metric(
            f"{name}.bias", float(off.mean()), spread, "std", "lower", len(off)
        )
        most = max(answer.largest for answer in good)
        yield Metric(f"{name}.largest", most, None, "std", "lower", len(off))
        relative = float(np.median([answer.relative for answer in good]))
        yield Metric(f"{name}.relative", relative, None, "1", "lower", len(off))


if __name__ == "__main__":
    main(Config, measure, tables, Config(count=2))
