"""Images, clouds and outlines of all kinds, and the fit that a user would make of each.

None is chosen for what a fit makes of it: seeds follow each other.
"""

__all__ = ["KINDS", "Case", "real"]

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import impostor_jax as ij
from experiments import scenes
from experiments.cross_ray_noise.scenes import KINDS as ERRORS
from experiments.cross_ray_noise.scenes import SIZES, draw_wall
from experiments.fit_views.scenes import draw_around
from experiments.last_bit import images
from experiments.sensor_models.scenes import SENSORS


@dataclasses.dataclass(frozen=True)
class Case:
    """What is fitted.

    Attributes:
        name: Of the case.
        fit: Fits it.
    """

    name: str
    fit: Callable[[], ij.Fit]


def _of_function(name: str, function: Callable, *given: Any, **options: Any) -> Case:
    return Case(name, lambda: function(*given, **options))


def _scenes(is_alone: bool) -> Iterator[Case]:
    """Random cylinders in clutter or alone, of all distances, sizes and turns."""
    for seed in range(200):
        view = scenes.draw_scene(seed, is_alone)
        yield _of_view(f"{seed}", ij.fit_cylinder, view, scenes.SENSOR)


def _of_view(name: str, function: Callable, view: scenes.View, sigma: Any) -> Case:
    return _of_function(
        name, function, view.depth, scenes.CAMERA, mask=view.mask, sigma=sigma
    )


SMALL = scenes.make_view(160, 120)


def _small() -> Iterator[Case]:
    """A can in small images at all angles, with and without anything behind it."""
    for degrees in range(0, 91, 10):
        angle = np.radians(degrees)
        axis = (0.3 * np.sin(angle), np.sin(angle), np.cos(angle))
        can = ij.Cylinder((0.01, 0.0, 0.35), axis, scenes.RADIUS, scenes.HEIGHT)
        maps = ij.render(can, SMALL, outputs=("depth", "mask"))
        mask = np.asarray(maps.mask)
        for wall in (0.6, np.inf):
            for sigma in (0.001, 0.003):
                rng = np.random.default_rng(degrees)
                depth = np.minimum(np.asarray(maps.depth), wall)
                depth = depth + rng.normal(0, sigma, depth.shape)
                depth = np.where(np.isfinite(depth), depth, 0).astype(np.float32)
                name = f"{degrees} degrees, wall {wall}, {1e3 * sigma:.0f} mm"
                yield _of_function(
                    name, ij.fit_cylinder, depth, SMALL, mask=mask, sigma=sigma
                )


def _shapes() -> Iterator[Case]:
    """Balls, cups and tubes."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        for sigma in (0.001, 0.003):
            name = f"{seed}, {1e3 * sigma:.0f} mm"
            ball = scenes.draw_ball(sigma, rng)
            yield _of_view(f"ball {name}", ij.fit_sphere, ball, sigma)
            cup = scenes.draw_cup(0.1, (30.0, 80.0), sigma, rng)
            yield _of_view(f"cup {name}", ij.fit_frustum, cup, sigma)
            tube = scenes.draw_tube(0.03, (20.0, 60.0), sigma, rng)
            yield _of_view(f"tube {name}", ij.fit_tube, tube, sigma)


def _outlines() -> Iterator[Case]:
    """Silhouettes of cans, as coverages and as masks, with a radius that is known."""
    for seed in range(10):
        case = scenes.FitCase((30.0, 90.0))
        can = scenes.draw_can(case, seed).shape
        masks = {
            "matte": np.asarray(ij.coverage(can, scenes.CAMERA)),
            "mask": np.asarray(ij.render(can, scenes.CAMERA, outputs=("mask",)).mask),
        }
        for kind, mask in masks.items():
            yield _of_function(
                f"{kind} {seed}",
                ij.fit_cylinder,
                None,
                scenes.CAMERA,
                mask=mask,
                sigma=0.05 if kind == "matte" else 0.0,
                mask_meaning="outline",
                prior={"radius": (scenes.RADIUS, 1e-4)},
            )


def _walls(reader: str) -> Iterator[Case]:
    """Walls whose readings err along and across their rays, the noise told or not."""
    for size in SIZES[reader]:
        for kind in ERRORS[reader]:
            for seed in range(3):
                rng = np.random.default_rng(seed)
                wall = draw_wall(reader, size, kind, rng)
                for sigma in (wall.errors.along, None):
                    name = f"{size}, {kind}, sigma {sigma}, {seed}"
                    if wall.depth is None:
                        given = (ij.fit_cylinder_to_points, wall.points, (0, 0, 0))
                        yield _of_function(name, *given, sigma=sigma)
                    else:
                        given = (ij.fit_cylinder, wall.depth, wall.camera, wall.mask)
                        yield _of_function(name, *given, sigma=sigma)


def _views() -> Iterator[Case]:
    """Two and four views of a can."""
    for count in (2, 4):
        rng = np.random.default_rng(0)
        for number in range(5):
            around = draw_around(count, 0.003, rng)
            yield Case(f"{count} views {number}", around.fit)


def _cameras() -> Iterator[Case]:
    """Cans on a table that whole cameras read, with the sensor told or nothing."""
    for sensor in SENSORS:
        for image in images.drawn(sensor, 10, seed=0):
            for name, told in (("told", image.sensor), ("nothing told", None)):
                one = dataclasses.replace(image, sensor=told)
                yield Case(f"{image.name}, {name}", one.fit)


def real(folder: Path) -> Iterator[Case]:
    """Photographs of depth, with the sensor told and with nothing told; stems."""
    for image in images.real(folder):
        yield Case(image.name, image.fit)
    for name in ("pine", "spruce"):
        points = np.load(folder / "field" / f"{name}_stem.npy")
        yield _of_function(name, ij.fit_cylinder_to_points, points)


KINDS: dict[str, Callable[[], Iterator[Case]]] = {
    "scenes": lambda: _scenes(is_alone=False),
    "alone": lambda: _scenes(is_alone=True),
    "small": _small,
    "shapes": _shapes,
    "outlines": _outlines,
    "points": lambda: _walls("points"),
    "scans": lambda: _walls("scan"),
    "pipes": lambda: _walls("image"),
    "views": _views,
    "cameras": _cameras,
}
"""Cases by kind; no two of a kind have one name."""
