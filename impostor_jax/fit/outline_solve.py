"""From a start to the body whose silhouette a mask shows, in the camera's frame.

First the distances of the mask's edge from the outline, which have a slope from far
away, then the coverages of the pixels beside that edge, which hold all that a mask
tells. Both are least squares with a robust loss, by Levenberg and Marquardt.

A silhouette does not change as a body grows and goes away from the camera alike. Where
the shape may do so, that motion is a coordinate of its own, in which no mask has a
slope, not one of rounding either.
"""

__all__ = [
    "OutlineProblem",
    "Traced",
    "coordinates",
    "coverage_errors",
    "outline_problem",
    "rays_through",
    "scale_coordinate",
    "traced",
]

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.body import AbstractBody, coordinates_of
from impostor_jax.fit.prior import Prior, prior_residuals
from impostor_jax.fit.problem import Settings
from impostor_jax.fit.robust import KERNELS, robust_residual
from impostor_jax.fit.silhouette import (
    RayDifferentials,
    coverage_of,
    distances,
    moved,
    nearest,
)
from impostor_jax.fit.solve import spread_of
from impostor_jax.geometry.frames import RigidTransform, unmoved
from impostor_jax.numerics import product
from impostor_jax.primitives.base import in_camera_frame

RIDGE = 3e-3
"""Inverse width, in pixels of motion, of the prior that keeps what the mask leaves open
in place."""

STEP_TOLERANCE = 0.02
"""Length of a last step, in pixels of motion over the deviation of a coverage, for an
`Effort` of tolerance 1."""

COARSE_TOLERANCE = 0.05
"""The same, in pixels, on the way to where coverages tell the rest."""

COARSE = 30
"""Most steps on the way to where coverages tell the rest."""


class OutlineProblem(eqx.Module):
    """A mask's edge, what is known beforehand, and what is asked.

    Attributes:
        edge: Places of the edge, all around it.
        is_place: Which of them are any; the others only fill up.
        pixels: Those beside the edge.
        covered: Part of each that is covered, as the mask has it.
        is_pixel: Which of them are any.
        place: Of each in the image, row by row; what only fills up lies beyond.
        sigma: Standard deviation of a coverage.
        edge_sigma: Standard deviation, in pixels, by which the edge is off all along.
        is_hard: Whether the mask tells of the pixels' centers alone.
        is_trusted: Whether `sigma` is known, and not a guess.
        grows: Whether the shape is free to grow and go away alike.
        has_scale: Whether anything that is known tells how large it is.
        footprint: Distance of neighboring rays over the depth.
        prior: In the camera frame.
        settings: What is asked for.
        world_from_camera: Inverse of the camera's pose.
        kernel: Name of the robust loss.
        max_steps: Of the solver.
    """

    edge: RayDifferentials
    is_place: Bool[Array, " m"]
    pixels: RayDifferentials
    covered: Float[Array, " n"]
    is_pixel: Bool[Array, " n"]
    place: Int[Array, " n"]
    sigma: Float[Array, ""]
    edge_sigma: Float[Array, ""]
    is_hard: Bool[Array, ""]
    is_trusted: Bool[Array, ""]
    grows: Bool[Array, ""]
    has_scale: Bool[Array, ""]
    footprint: Float[Array, ""]
    prior: Prior
    settings: Settings
    world_from_camera: RigidTransform
    kernel: str = eqx.field(static=True)
    max_steps: int = eqx.field(static=True)

    def in_world(self, body: AbstractBody) -> AbstractBody:
        """A body of the camera's frame in that of the world."""
        return body.transformed(self.world_from_camera)


class Traced(NamedTuple):
    """Where a start led.

    Attributes:
        body: In the camera frame.
        loss: What it leaves, robustly.
        converged: Whether the last step was short.
        num_steps: Steps that it took.
    """

    body: AbstractBody
    loss: Float[Array, ""]
    converged: Bool[Array, ""]
    num_steps: Int[Array, ""]


def outline_problem(
    places: tuple[Array, ...],
    pixels: tuple[Array, ...],
    sigma: Float[Array, ""],
    edge_sigma: Float[Array, ""],
    facts: dict[str, Bool[Array, ""]],
    prior: Prior,
    settings: Settings,
    camera: PinholeCamera,
    kernel: str,
    max_steps: int,
) -> OutlineProblem:
    """Gather the problem of a mask: all that knows the image's size and the camera.

    Args:
        places: Rows and columns of pixels, and steps from their centers to the edge
            along columns and rows; a row beyond the image only fills up.
        pixels: Rows, columns and coverages of the pixels beside the edge.
        sigma: Standard deviation of a coverage.
        edge_sigma: Standard deviation of the edge, in pixels.
        facts: The problem's own, by name.
        prior: In the world frame.
        settings: What is asked for.
        camera: The camera.
        kernel: Name of the robust loss.
        max_steps: Of the solver.
    """
    (row, col, cols, rows), (own_row, own_col, covered) = places, pixels
    pose = camera.camera_from_world or unmoved(sigma.dtype)
    return OutlineProblem(
        edge=moved(rays_through(camera, row, col), cols, rows),
        is_place=row < camera.height,
        pixels=rays_through(camera, own_row, own_col),
        covered=covered,
        is_pixel=own_row < camera.height,
        place=own_row * camera.width + own_col,
        sigma=sigma,
        edge_sigma=edge_sigma,
        footprint=1 / jnp.minimum(camera.fx, camera.fy).astype(sigma.dtype),
        prior=in_camera_frame(prior, camera),
        settings=settings,
        world_from_camera=pose.inverse(),
        kernel=kernel,
        max_steps=max_steps,
        **facts,
    )


def rays_through(
    camera: PinholeCamera, row: Int[Array, " n"], col: Int[Array, " n"]
) -> RayDifferentials:
    """Rays through pixels; their changes are those from neighbor to neighbor.

    Through a lens rays are known through the centers of pixels alone.
    """
    height, width = camera.height, camera.width
    row = jnp.clip(row, 0, height - 1)
    dtype = jnp.result_type(float)

    def at(row: Int[Array, " n"], col: Int[Array, " n"]) -> tuple[Array, Array]:
        direction = camera.rays(row, col, dtype).direction
        return direction.x, direction.y

    def change(down: int, right: int) -> tuple[Array, Array]:
        first = jnp.clip(row - down, 0), jnp.clip(col - right, 0)
        last = (
            jnp.clip(row + down, 0, height - 1),
            jnp.clip(col + right, 0, width - 1),
        )
        count = (last[0] - first[0] + last[1] - first[1]).astype(dtype)
        (x, y), (far_x, far_y) = at(*first), at(*last)
        return (far_x - x) / count, (far_y - y) / count

    x, y = at(row, col)
    return RayDifferentials(x=x, y=y, by_col=change(0, 1), by_row=change(1, 0))


def coordinates(problem: OutlineProblem, body: AbstractBody) -> Float[Array, "c c"]:
    """Tangent coordinates that one unit of each free coordinate moves, as columns.

    One unit moves the outline by about a pixel. Where the shape may grow and go away
    alike, that motion takes the place of a radius.
    """
    settings = problem.settings
    unit = problem.footprint * jnp.maximum(body.center[2], body.radius)
    basis = body.free_basis(settings.free, unit, unit)
    own = scale_coordinate(body)
    still = jnp.zeros_like(unit)
    leaves = jax.tree.leaves
    _, grown = jax.jvp(lambda s: leaves(body.magnified(s)), (still,), (still + 1,))
    change = jax.jacfwd(lambda t: leaves(body.retracted(t, settings.free)))(
        jnp.zeros_like(basis[0])
    )
    rows = [part.reshape(-1, basis.shape[0]) for part in change]
    away = jnp.concatenate([part.reshape(-1) for part in grown])
    # What the radius has a share in moves the body as a whole.
    motion, *_ = jnp.linalg.lstsq(jnp.concatenate(rows), away)
    motion = motion * (unit / body.radius)
    return jnp.where(problem.grows, basis.at[:, own].set(motion), basis)


def scale_coordinate(body: AbstractBody) -> int:
    """Place of the coordinate that is the scale where this is free: a radius."""
    return len(coordinates_of(body)) - len(body.ends) - 1


def traced(problem: OutlineProblem, start: AbstractBody, to_end: bool) -> Traced:
    """Go from a start to where a mask's edge, or its coverages, are met best.

    Args:
        problem: What was given.
        start: In the camera frame.
        to_end: Whether coverages count, from a start less than a pixel off, or the
            places of the edge.
    """
    settings, basis = problem.settings, coordinates(problem, start)
    kernel = problem.kernel if to_end else "pseudo_huber"
    width = KERNELS[kernel][1]

    def body_at(free: Float[Array, " c"]) -> AbstractBody:
        return start.retracted(product(basis, free), settings.free)

    def left(body: AbstractBody) -> Float[Array, " n"]:
        return coverage_errors(problem, body) if to_end else place_errors(problem, body)

    if to_end:
        off = left(start)
        spread = jnp.where(settings.estimate_scale, spread_of(off, off != 0), 1)
        width = width * spread

    def residuals(free: Float[Array, " c"], _: None) -> Float[Array, " m"]:
        body = body_at(free)
        robust = robust_residual(left(body), width, kernel)
        known = prior_residuals(problem.prior, body)
        return jnp.concatenate([robust, known, RIDGE * free])

    fine: Any = STEP_TOLERANCE * problem.sigma * jnp.asarray(settings.tolerance)
    found = optx.least_squares(
        residuals,
        optx.LevenbergMarquardt(rtol=1e-3, atol=fine if to_end else COARSE_TOLERANCE),
        jnp.zeros_like(basis[0]),
        max_steps=problem.max_steps if to_end else COARSE,
        throw=False,
    )
    return Traced(
        body=body_at(found.value),
        loss=jnp.sum(residuals(found.value, None) ** 2) / 2,
        converged=found.result == optx.RESULTS.successful,
        num_steps=found.stats["num_steps"],
    )


def place_errors(problem: OutlineProblem, body: AbstractBody) -> Float[Array, " m"]:
    """How far within the outline places of the edge are, in pixels."""
    distance, _ = nearest(distances(body, problem.edge))
    return jnp.where(problem.is_place, distance, 0)


def coverage_errors(problem: OutlineProblem, body: AbstractBody) -> Float[Array, " n"]:
    """Coverages of a body's silhouette less the mask's, in standard deviations."""
    off = (coverage_of(body, problem.pixels) - problem.covered) / problem.sigma
    return jnp.where(problem.is_pixel, off, 0)
