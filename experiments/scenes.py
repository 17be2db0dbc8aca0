"""Cans, cups, tubes, balls, random cylinders before a camera; noisy images of them."""

__all__ = [
    "CAMERA",
    "DISTANCE",
    "HEIGHT",
    "RADIUS",
    "SENSOR",
    "SIGMA",
    "FitCase",
    "Image",
    "Mask",
    "Shape",
    "View",
    "draw_ball",
    "draw_can",
    "draw_cup",
    "draw_scene",
    "draw_tube",
    "make_can",
    "make_view",
    "seen_plainly",
    "with_noise",
]

import dataclasses
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

import impostor_jax as ij
from impostor_jax.geometry.vec3 import Vec3

RADIUS, HEIGHT = 0.04, 0.12
"""Of the can, in meters; of a ball, and of the wider end of a cup, and of a cup."""

DISTANCE = 0.8
"""Of what is seen, in meters."""

WALL = 1.2
"""Distance of the wall behind it, in meters."""

SIGMA = 0.001
"""Deviation of a noisy image's readings, in meters, where nothing else is said."""

SENSOR = ij.StructuredLight()
"""Of random scenes."""

OUTLIERS = 0.1
"""Part of a random scene's readings that are drawn from 0.3 to 4 m, or of one without
clutter that are moved."""

MOVED = 0.1
"""Distance, in meters, by which those are at most."""

LEAST_SEEN = 0.6
"""Part of a random cylinder's pixels that must be in the frame and not occluded."""

Shape: TypeAlias = ij.Cylinder | ij.Frustum | ij.Sphere | ij.Solid
Image: TypeAlias = Float[np.ndarray, "h w"]
Mask: TypeAlias = Bool[np.ndarray, "h w"]


@dataclasses.dataclass(frozen=True)
class View:
    """One image of one shape by `CAMERA`.

    Attributes:
        shape: The truth, in the camera frame.
        depth: What was read, in meters.
        mask: Pixels whose ray hits the shape, and which are not occluded.
        sigma: Deviation of a reading, in meters.
    """

    shape: Shape
    depth: Image
    mask: Mask
    sigma: float | Image


@dataclasses.dataclass(frozen=True)
class FitCase:
    """What the images of a can have in common.

    Attributes:
        degrees: Least and largest angle between the axis and the view.
        sigma: Deviation of a reading, in meters.
        outliers: Part of the readings that are drawn from 0.3 to 1.5 m.
        correlation: Distance in pixels at which the errors' correlation is 1/e; 0 for
            white noise.
    """

    degrees: tuple[float, float]
    sigma: float = SIGMA
    outliers: float = 0.0
    correlation: float = 0.0


def make_view(width: int, height: int) -> ij.PinholeCamera:
    """A camera that sees 63 degrees from left to right, in so many pixels."""
    focal = 525 * width / 640
    center = (width - 1) / 2, (height - 1) / 2
    return ij.PinholeCamera(focal, focal, *center, width, height)


CAMERA = make_view(640, 480)


def make_can(grown: float = 1.0) -> ij.Cylinder:
    """The can in the middle of the view, its sizes multiplied by `grown`."""
    place, axis = (0, 0, DISTANCE), (0.3, 0.8, 0.52)
    return ij.Cylinder(place, axis, RADIUS * grown, HEIGHT * grown)


def with_noise(depth: Image, sigma: float, rng: np.random.Generator) -> Image:
    """A depth image with the wall behind the shape, and white noise."""
    read = np.minimum(depth, WALL) + rng.normal(0, sigma, depth.shape)
    return read.astype(np.float32)


def draw_can(case: FitCase, seed: int) -> View:
    """An image of the can.

    Its place in the image and the turn of its axis there are drawn, too: how its edge
    falls on the pixels is chance like the noise, and no part of a bias.
    """
    rng = np.random.default_rng(seed)
    axis = _axis(case.degrees, (0.3, 1.2), rng)
    center = np.array([0.02, 0.01, DISTANCE]) + rng.uniform(-0.01, 0.01, 3)
    can = ij.Cylinder(center, axis, RADIUS, HEIGHT)
    true, mask = _seen(can)
    depth = np.minimum(true, WALL) + case.sigma * _errors(case.correlation, rng)
    wrong = rng.random(true.shape) < case.outliers
    depth = np.where(wrong, rng.uniform(0.3, 1.5, true.shape), depth)
    return View(can, depth.astype(np.float32), mask, case.sigma)


def draw_ball(sigma: float, rng: np.random.Generator) -> View:
    """A ball somewhere in the image."""
    center = np.array([0.0, 0.0, DISTANCE]) + rng.uniform(-0.1, 0.1, 3)
    return _view(ij.Sphere(center, RADIUS), sigma, rng)


def draw_cup(
    taper: float,
    degrees: tuple[float, float],
    sigma: float,
    rng: np.random.Generator,
) -> View:
    """A cup whose axis makes an angle with the view, its narrow end ahead.

    Args:
        taper: Part of the radius by which the other end is narrower.
        degrees: Least and largest angle.
        sigma: Deviation of a reading, in meters.
        rng: Source of all that is drawn.
    """
    half = _axis(degrees, (0, 2 * np.pi), rng) * HEIGHT / 2
    center = np.array([0.0, 0.0, DISTANCE]) + rng.uniform(-0.05, 0.05, 3)
    narrow = RADIUS * (1 - taper)
    return _view(ij.Frustum(center - half, center + half, narrow, RADIUS), sigma, rng)


def draw_tube(
    inner_radius: float,
    degrees: tuple[float, float],
    sigma: float,
    rng: np.random.Generator,
) -> View:
    """A tube as large as the can whose axis makes an angle with the view.

    Args:
        inner_radius: Of the bore, in meters; 0 of the can.
        degrees: Least and largest angle.
        sigma: Deviation of a reading, in meters.
        rng: Source of all that is drawn.
    """
    axis = _axis(degrees, (0, 2 * np.pi), rng)
    center = np.array([0.0, 0.0, DISTANCE]) + rng.uniform(-0.05, 0.05, 3)
    if inner_radius == 0:
        return _view(ij.Cylinder(center, axis, RADIUS, HEIGHT), sigma, rng)
    return _view(ij.tube(center, axis, RADIUS, inner_radius, HEIGHT), sigma, rng)


def _axis(
    degrees: tuple[float, float], turns: tuple[float, float], rng: np.random.Generator
) -> Float[np.ndarray, "3"]:
    """An axis at an angle to the view, turned by another in the image."""
    angle, turn = np.radians(rng.uniform(*degrees)), rng.uniform(*turns)
    sine = np.sin(angle)
    return np.array([sine * np.cos(turn), sine * np.sin(turn), np.cos(angle)])


def _seen(shape: Shape) -> tuple[Image, Mask]:
    maps = ij.render(shape, CAMERA, outputs=("depth", "mask"))
    return np.asarray(maps.depth), np.asarray(maps.mask)


def _view(shape: Shape, sigma: float, rng: np.random.Generator) -> View:
    depth, mask = _seen(shape)
    return View(shape, with_noise(depth, sigma, rng), mask, sigma)


def seen_plainly(view: View) -> Image:
    """Depth of a view without noise, the wall behind included."""
    return np.minimum(_seen(view.shape)[0], WALL).astype(np.float32)


def _errors(correlation: float, rng: np.random.Generator) -> Image:
    """Normal errors of unit deviation."""
    errors = rng.normal(size=(CAMERA.height, CAMERA.width))
    if correlation == 0:
        return errors
    # Not with this module: it would count as memory of a first render.
    import cv2

    # Noise blurred by a Gaussian has a correlation of twice its variance.
    spread = correlation / 2
    errors = cv2.GaussianBlur(errors, (0, 0), spread)
    kernel = cv2.getGaussianKernel(8 * int(np.ceil(spread)) + 1, spread)
    return errors / np.sum(kernel**2)


def draw_scene(seed: int, is_alone: bool = False) -> View:
    """A random cylinder in clutter; one that shows too little is drawn again.

    The axis is uniform on the sphere, the center 0.3 to 3 m away, the radius from 1 to
    20 cm and the height from 0.2 to 20 radii, both with uniform logarithms. A plane
    stands behind. In a third of the scenes the cylinder is partly out of the frame, in
    a third it is partly occluded. It shows at least 400 pixels, 150 of them on the
    wall, its radius is at most 0.3 of its distance and the camera is outside.

    Args:
        seed: Of all that is drawn.
        is_alone: Whether nothing else has a reading. Outliers are then as far from the
            surface as `MOVED`, where no robust loss knows them at once; half of the
            cylinders are partly occluded, and the others within the frame.
    """
    rng = np.random.default_rng(seed)
    while True:
        distance = rng.uniform(0.3, 3.0)
        radius = np.exp(rng.uniform(np.log(0.01), np.log(0.2)))
        height = radius * np.exp(rng.uniform(np.log(0.2), np.log(20)))
        axis = rng.normal(size=3)
        kind = 2 * rng.integers(2) if is_alone else rng.integers(3)
        reach = 1.3 if kind == 1 else 0.6
        u = 320 + rng.uniform(-320, 320) * reach
        v = 240 + rng.uniform(-240, 240) * reach
        ray = np.array([(u - 319.5) / 525, (v - 239.5) / 525, 1.0])
        center = distance * ray / np.linalg.norm(ray)
        if radius > 0.3 * distance:
            continue
        cylinder = ij.Cylinder(center, axis, radius, height)
        scene = _in_clutter(cylinder, kind == 2, is_alone, rng)
        if scene is not None:
            return scene


@jax.jit
def _with_margin(cylinder: ij.Cylinder):
    """Depth, mask, wall, cosine of incidence; number of pixels, in the frame or not."""
    wide = ij.PinholeCamera(525.0, 525.0, 639.5, 479.5, width=1280, height=960)
    maps = ij.render(cylinder, wide)
    assert maps.depth is not None
    assert maps.normal is not None
    assert maps.mask is not None
    part = np.s_[240:720, 320:960]
    row, col = wide.frame.pixels()
    d = wide.rays(row, col, maps.depth.dtype).direction.stack()
    cosine = -jnp.sum(maps.normal * d, axis=-1) / jnp.linalg.norm(d, axis=-1)
    point = (
        jnp.where(maps.mask, maps.depth, 0)[..., None] * d - cylinder.center[None, None]
    )
    along = jnp.abs(point @ cylinder.axis)
    on_wall = maps.mask & (along < cylinder.height / 2 * (1 - 1e-4))
    shown = (x[part] for x in (maps.depth, maps.mask, on_wall, cosine))
    return (*shown, jnp.sum(maps.mask))


def _in_clutter(
    cylinder: ij.Cylinder, occluded: bool, is_alone: bool, rng: np.random.Generator
) -> View | None:
    implicit = cylinder.implicit(Vec3(*jnp.zeros(3)))
    found = (np.asarray(x) for x in _with_margin(cylinder))
    depth, mask, on_wall, cosine, total = found
    if float(implicit) <= 0 or mask.sum() < 400:
        return None
    row, col = np.mgrid[0:480, 0:640]
    if occluded:
        # A board in front hides the part beyond a line through the object.
        angle = rng.uniform(0, 2 * np.pi)
        place = col * np.cos(angle) + row * np.sin(angle)
        cut = np.quantile(place[mask], rng.uniform(0.6, 1.0))
        board = place > cut
    else:
        board = np.zeros_like(mask)
    seen = mask & ~board
    if seen.sum() < max(400, LEAST_SEEN * total) or (seen & on_wall).sum() < 150:
        return None
    farthest = depth[mask].max()
    tilt = rng.uniform(-0.3, 0.3, 2)
    plane = 1 + tilt[0] * (col - 320) / 525 + tilt[1] * (row - 240) / 525
    behind = (farthest + rng.uniform(0.05, 1.0)) / np.minimum(plane, 1)
    full = np.where(mask, depth, behind)
    full = np.where(board, 0.7 * depth[mask].min(), full)
    cosine = np.where(seen, cosine, 1).astype(np.float32)
    sigma = np.asarray(
        SENSOR.sigma(jnp.asarray(full, jnp.float32), jnp.asarray(cosine))
    )
    read = full + sigma * rng.normal(size=full.shape)
    wrong = rng.random(full.shape) < OUTLIERS
    if is_alone:
        moved = read + rng.uniform(-MOVED, MOVED, full.shape)
        read = np.where(seen, np.where(wrong, moved, read), 0)
    else:
        read = np.where(wrong, rng.uniform(0.3, 4.0, full.shape), read)
    return View(cylinder, np.maximum(read, 0).astype(np.float32), seen, sigma)
