"""Noisy images of balls, cups and cans, and the bound of their fits."""

__all__ = [
    "COORDINATES",
    "View",
    "bound",
    "draw_ball",
    "draw_cup",
    "error",
]

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

import impostor_jax as ij
from experiments.fit_accuracy.bound import least_deviation
from experiments.fit_accuracy.cases import CAMERA, DISTANCE, WALL
from impostor_jax.fit.ball import Ball
from impostor_jax.fit.round_body import RoundBody
from impostor_jax.geometry.so3 import tangent_basis

RADIUS, HEIGHT = 0.04, 0.12
"""Of a ball and of the wider end of a cup, and of a cup, in meters."""

COORDINATES = {
    "sphere": ("center_x", "center_y", "center_z", "radius"),
    "frustum": (
        *("axis_first", "axis_second", "center_first", "center_second"),
        *("radius", "slope"),
    ),
}
"""What is compared: of a frustum the wall, by its radius beside the true center and the
change of that along the axis. Depths tell little of an end that faces away."""


@dataclasses.dataclass(frozen=True)
class View:
    """One image of one shape.

    Attributes:
        shape: The truth, in the camera frame.
        depth: What was read, in meters.
        mask: Pixels whose ray hits the shape.
    """

    shape: ij.Sphere | ij.Frustum
    depth: Float[np.ndarray, "h w"]
    mask: Bool[np.ndarray, "h w"]


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
    angle, turn = np.radians(rng.uniform(*degrees)), rng.uniform(0, 2 * np.pi)
    across = np.sin(angle) * np.array([np.cos(turn), np.sin(turn)])
    half = np.array([*across, np.cos(angle)]) * HEIGHT / 2
    center = np.array([0.0, 0.0, DISTANCE]) + rng.uniform(-0.05, 0.05, 3)
    narrow = RADIUS * (1 - taper)
    return _view(ij.Frustum(center - half, center + half, narrow, RADIUS), sigma, rng)


def _view(
    shape: ij.Sphere | ij.Frustum, sigma: float, rng: np.random.Generator
) -> View:
    maps = ij.render(shape, CAMERA, outputs=("depth", "mask"))
    true = np.minimum(np.asarray(maps.depth), WALL)
    depth = true + rng.normal(0, sigma, true.shape)
    return View(shape, depth.astype(np.float32), np.asarray(maps.mask))


def error(
    estimate: ij.Sphere | ij.Frustum, truth: ij.Sphere | ij.Frustum
) -> Float[np.ndarray, " k"]:
    """Estimate less truth, in `COORDINATES`."""
    if isinstance(estimate, ij.Sphere) and isinstance(truth, ij.Sphere):
        moved = np.asarray(estimate.center, float) - np.asarray(truth.center, float)
        return np.append(moved, float(estimate.radius) - float(truth.radius))
    one, other = _Wall.of(estimate), _Wall.of(truth)
    sign = np.sign(one.axis @ other.axis)
    basis = np.asarray(tangent_basis(jnp.asarray(other.axis, jnp.float32)), float)
    # Where the estimated axis passes beside the true center.
    along = (other.center - one.center) @ one.axis
    beside = one.center + along * one.axis
    return np.concatenate(
        [
            basis @ (sign * one.axis - other.axis),
            basis @ (beside - other.center),
            [
                one.radius + along * one.slope - other.radius,
                sign * one.slope - other.slope,
            ],
        ]
    )


@dataclasses.dataclass(frozen=True)
class _Wall:
    """Axis of a frustum, radius at its center, and slope."""

    center: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    radius: float
    slope: float

    @staticmethod
    def of(frustum: ij.Sphere | ij.Frustum) -> "_Wall":
        assert isinstance(frustum, ij.Frustum)
        p1, p2 = np.asarray(frustum.p1, float), np.asarray(frustum.p2, float)
        height = float(np.linalg.norm(p2 - p1))
        radius1, radius2 = float(frustum.radius1), float(frustum.radius2)
        slope = (radius2 - radius1) / height
        return _Wall((p1 + p2) / 2, (p2 - p1) / height, (radius1 + radius2) / 2, slope)


def bound(view: View, sigma: float, reachable: bool = False) -> Float[np.ndarray, " k"]:
    """Least deviation of an unbiased estimate from the mask's depths.

    From the derivatives of all depths, in double precision; the ends are unknown, too.
    Where a ray grazes the wall, its depth n - h changes without bound with the
    half-chord h, and the bound counts on that, though noise as large as h blurs it.

    Args:
        view: The image.
        sigma: Deviation of a reading, in meters.
        reachable: Whether a reading counts for what its square tells of h^2, with the
            variance 4 h^2 sigma^2 + 2 sigma^4 that this has.
    """
    shape = view.shape
    with jax.enable_x64(True):
        exact = jax.tree.map(lambda field: np.asarray(field, np.float64), shape)
        if isinstance(shape, ij.Sphere):
            columns, half = _sphere_derivatives(exact), _half_chord(Ball.of(exact))
        else:
            columns = _frustum_derivatives(exact)
            half = _half_chord(RoundBody.of(exact))
        used = np.asarray(columns)[view.mask]
        half = np.asarray(half)[view.mask][:, None]
    if reachable:
        used = used * half / np.sqrt(half**2 + sigma**2 / 2)
    kind = "sphere" if isinstance(shape, ij.Sphere) else "frustum"
    return least_deviation(used / sigma)[: len(COORDINATES[kind])]


@jax.jit
def _half_chord(body: Ball | RoundBody) -> Float[Array, "h w"]:
    """Half the stretch of a ray within the wall, in depth; very long on caps."""
    row, col = CAMERA.frame.pixels()
    seen = body.passing(CAMERA.rays(row, col, body.radius.dtype).direction)
    return jnp.where(seen.on_cap, 1e9, jnp.sqrt(jnp.maximum(seen.square, 0)))


@jax.jit
def _sphere_derivatives(sphere: ij.Sphere) -> Float[Array, "h w 4"]:
    def depth(move: Float[Array, "4"]) -> Float[Array, "h w"]:
        return _depth(ij.Sphere(sphere.center + move[:3], sphere.radius + move[3]))

    return _finite(jax.jacfwd(depth)(jnp.zeros(4)))


@jax.jit
def _frustum_derivatives(frustum: ij.Frustum) -> Float[Array, "h w 8"]:
    way = frustum.p2 - frustum.p1
    height = jnp.linalg.norm(way)
    basis = tangent_basis(frustum.axis)

    def depth(move: Float[Array, "8"]) -> Float[Array, "h w"]:
        axis = frustum.axis + basis.T @ move[:2]
        center = (frustum.p1 + frustum.p2) / 2 + basis.T @ move[2:4]
        radius = (frustum.radius1 + frustum.radius2) / 2 + move[4]
        slope = (frustum.radius2 - frustum.radius1) / height + move[5]
        low, high = -height / 2 + move[6], height / 2 + move[7]
        ends = center + axis * low, center + axis * high
        return _depth(ij.Frustum(*ends, radius + slope * low, radius + slope * high))

    return _finite(jax.jacfwd(depth)(jnp.zeros(8)))


def _depth(shape: ij.Sphere | ij.Frustum) -> Float[Array, "h w"]:
    maps = ij.render(shape, CAMERA, outputs=("depth",))
    assert maps.depth is not None
    return maps.depth


def _finite(columns: Float[Array, "h w k"]) -> Float[Array, "h w k"]:
    return jnp.where(jnp.isfinite(columns), columns, 0)
