"""What a solution shows: its ends, and whether it can be believed."""

__all__ = ["is_as_flat", "seen_extent", "status_code"]

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.fit.residuals import Rows, SurfaceSeen
from impostor_jax.fit.result import STATUSES, FitStatus
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
    ends_seen = jnp.stack(
        [jnp.sum(believed & (shown == end)) >= MIN_END_ROWS for end in (-1, 1)]
    )
    on_wall = believed & is_reading & ~seen.on_cap
    half = cylinder.height / 2
    first = jnp.min(jnp.where(on_wall, seen.along, jnp.inf))
    last = jnp.max(jnp.where(on_wall, seen.along, -jnp.inf))
    low = jnp.where(ends_seen[0], -half, first)
    high = jnp.where(ends_seen[1], half, last)
    # Without a wall there is no extent to draw in to.
    empty = ~(jnp.isfinite(low) & jnp.isfinite(high) & (high > low))
    low, high = jnp.where(empty, -half, low), jnp.where(empty, half, high)
    center = cylinder.center + cylinder.axis * ((low + high) / 2)
    return (
        eqx.tree_at(lambda c: (c.center, c.height), cylinder, (center, high - low)),
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
    d, depth = rows.ray.direction, rows.target[:count]
    inverse = jnp.where(inlier, 1 / jnp.where(inlier, depth, 1), 0)
    weight = jnp.where(inlier, rows.weight[:count] * depth, 0)
    rays = jnp.stack([d.x[:count], d.y[:count], d.z[:count]]) * (weight * depth)[None]
    normal = jnp.matmul(rays, rays.T, precision="highest")
    right = jnp.matmul(rays, weight * depth * inverse, precision="highest")
    plane = jnp.linalg.solve(normal, right)
    flat = jnp.matmul(plane, rays, precision="highest") - weight * depth * inverse
    scale = jnp.maximum(
        squares / jnp.maximum(jnp.sum(inlier), 1).astype(depth.dtype), 1
    )
    return jnp.sum(flat**2) < squares + 25 * scale
