"""What a solution shows: its ends, and whether it can be believed."""

__all__ = ["is_as_flat", "seen_extent", "status_code"]

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.fit.residuals import Rows, SurfaceSeen
from impostor_jax.fit.result import STATUSES, FitStatus
from impostor_jax.numerics import safe_divide
from impostor_jax.primitives.cylinder import Cylinder

MIN_END_ROWS = 5
"""Fewest inlying readings of a cap, or crossings, that show an end."""


def seen_extent(
    cylinder: Cylinder, rows: Rows, seen: SurfaceSeen, believed: Bool[Array, " n"]
) -> tuple[Cylinder, Bool[Array, "2"]]:
    """Tell which ends are seen, and draw an unseen one in to the last inlier.

    An end is seen through readings well inside its cap's disc, or where the wall gives
    way to background.
    """
    is_reading = rows.end == 0
    # Along the rim, wall and cap are not told apart by a noisy reading.
    on_cap = is_reading & seen.on_cap & (seen.cap_distance_squared < 0.9**2)
    shown = jnp.where(on_cap, seen.cap_end, rows.end)
    ends = jnp.array([-1, 1], shown.dtype)[:, None]
    counts = jnp.sum(believed[None] & (shown[None] == ends), axis=1)
    ends_seen = counts >= MIN_END_ROWS
    on_wall = believed & is_reading & ~seen.on_cap
    outward = jnp.where(on_wall[None], seen.along[None] * ends, -jnp.inf)
    half = cylinder.height / 2
    # How far the lower and the upper end lie from the center, each on its own side.
    reach = jnp.where(ends_seen, half, jnp.max(outward, axis=1))
    # Without a wall there is no extent to draw in to.
    height = jnp.sum(reach)
    has_wall = jnp.isfinite(height) & (height > 0)
    shift = jnp.where(has_wall, reach[1] - reach[0], 0) / 2
    height = jnp.where(has_wall, height, cylinder.height)
    center = cylinder.center + cylinder.axis * shift
    return (
        eqx.tree_at(lambda c: (c.center, c.height), cylinder, (center, height)),
        ends_seen,
    )


def status_code(
    converged: Bool[Array, ""],
    finite: Bool[Array, ""],
    fits: Bool[Array, ""],
    determined: Bool[Array, ""],
) -> Int[Array, ""]:
    """Code of the first thing that went wrong."""
    code = {status: STATUSES.index(status) for status in FitStatus}
    return jnp.select(
        [~finite, ~converged, ~fits, ~determined],
        [
            jnp.array(code[FitStatus.NOT_FINITE]),
            jnp.array(code[FitStatus.STEP_LIMIT]),
            jnp.array(code[FitStatus.POOR_FIT]),
            jnp.array(code[FitStatus.UNDETERMINED]),
        ],
        jnp.array(code[FitStatus.CONVERGED]),
    )


def is_as_flat(
    rows: Rows, inlier: Bool[Array, " n"], squares: Float[Array, ""]
) -> Bool[Array, ""]:
    """Whether a plane explains the readings as well as the cylinder does.

    A plane is linear in inverse depth over the rays, so one linear solve finds it. A
    cylinder has to beat it by 25, in squared deviations.

    Args:
        rows: Readings first, then ends.
        inlier: Readings that lie on the cylinder.
        squares: Sum of their squared residuals from it, in deviations.
    """
    count = inlier.shape[0]
    d, depth = rows.direction, rows.target[:count]
    inverse = jnp.where(inlier, 1 / jnp.where(inlier, depth, 1), 0)
    weight = jnp.where(inlier, rows.weight[:count] * depth, 0)
    rays = jnp.stack([d.x[:count], d.y[:count], d.z[:count]]) * (weight * depth)[None]
    normal = jnp.matmul(rays, rays.T, precision="highest")
    right = jnp.matmul(rays, weight * depth * inverse, precision="highest")
    # Cramer's rule: the rows of the adjugate are cross products.
    adjugate = jnp.cross(jnp.roll(normal, -1, axis=0), jnp.roll(normal, -2, axis=0))
    determinant = jnp.sum(normal[0] * adjugate[0])
    inverse_determinant = safe_divide(jnp.ones_like(determinant), determinant)
    plane = jnp.sum(adjugate.T * right[None], axis=1) * inverse_determinant
    flat = jnp.matmul(plane, rays, precision="highest") - weight * depth * inverse
    scale = jnp.maximum(
        squares / jnp.maximum(jnp.sum(inlier), 1).astype(depth.dtype), 1
    )
    return jnp.sum(flat**2) < squares + 25 * scale
