"""First guess of a tube: a cylinder's, and the wall that is seen within it.

Normals face the camera. On the outer wall they lead away from the axis, on that of the
bore towards it, so they tell which of two circles about one center a point is on.
"""

__all__ = ["closed", "guess_tubes"]

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.fit.guess_round import guess_cylinders
from impostor_jax.fit.round_body import RoundBody
from impostor_jax.fit.rounds import FEWEST_POINTS, blank_where, largest_of, median_of
from impostor_jax.fit.surface import MAX_POINTS, Samples
from impostor_jax.fit.tube_body import TubeBody
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.numerics import eps

MOST_LENGTHWISE = 0.5
"""Cosine with the axis up to which a normal is a wall's."""

LEAST_RADIAL = 0.5
"""Cosine with the direction from the axis from which a wall's normal tells its side."""

LEAST, MOST = 0.02, 0.97
"""Inner radius of a guess, in outer ones."""

CLOSED = 0.01
"""The same of one without a bore."""

UNSEEN = 0.5
"""The same of one whose ends are not seen."""

NEAR = 0.15
"""Distance from a wall, in radii, within which a point is on it."""

STRAY = 0.01
"""Share of a wall's points, at each end of it, that are strays."""


def guess_tubes(samples: Samples) -> tuple[TubeBody, Bool[Array, " g"]]:
    """Tubes in the camera frame about `guess_cylinders`, and which of them are any."""
    bodies, are_any = guess_cylinders(samples)
    with jax.default_matmul_precision("highest"):
        tubes = jax.vmap(lambda body: _with_bore(body, samples))(bodies)
    tubes = jax.tree.map(lambda x: x.astype(bodies.radius.dtype), tubes)
    return blank_where(~are_any, tubes), are_any


def closed(body: TubeBody) -> TubeBody:
    """The same outside, with hardly any bore."""
    return eqx.tree_at(lambda b: b.inner_radius, body, CLOSED * body.radius)


def _with_bore(body: RoundBody, samples: Samples) -> TubeBody:
    basis = tangent_basis(body.axis)
    frame = jnp.concatenate([basis, body.axis[None]])
    points = (samples.points - body.center[None]) @ frame.T
    places = (samples.normal_points - body.center[None]) @ frame.T
    normals = samples.normals @ frame.T
    from_axis = jnp.sqrt(jnp.sum(places[:, :2] ** 2, axis=1))
    radial = jnp.sum(normals[:, :2] * places[:, :2], axis=1)
    radial = radial / jnp.maximum(from_axis, jnp.finfo(radial.dtype).tiny)
    is_wall = jnp.abs(normals[:, 2]) < MOST_LENGTHWISE
    outside, inside = (
        is_wall & (radial > LEAST_RADIAL),
        is_wall & (radial < -LEAST_RADIAL),
    )
    fewest = FEWEST_POINTS * jnp.maximum(MAX_POINTS / samples.num_normals, 1)
    sums = (jnp.sum(wall, dtype=fewest.dtype) for wall in (outside, inside))
    has_outer, has_inner = (count >= fewest for count in sums)
    middle, outer, inner = _circles(places[:, :2], outside, inside)
    # A cylinder's guess may be a circle through both walls.
    is_better = has_inner & jnp.all(jnp.isfinite(middle)) & (outer > 0) & (inner > 0)
    middle = jnp.where(is_better, middle, 0)
    radius = jnp.where(is_better & has_outer, outer, body.radius)
    rho = jnp.sqrt(jnp.sum((points[:, :2] - middle[None]) ** 2, axis=1))
    inner = jnp.where(is_better, inner, 0)
    # Without an outer wall the ring around the bore tells how thick it is.
    count = jnp.sum(rho > inner, dtype=rho.dtype)
    rank = jnp.ceil(STRAY * count).astype(jnp.int32)
    most = int(np.ceil(STRAY * MAX_POINTS)) + 1
    widest = largest_of(rho, rho > inner, rank, most)
    ring = jnp.maximum(jnp.where(jnp.isfinite(widest), widest, 0), inner / MOST)
    radius = jnp.where(is_better & ~has_outer, ring, radius)
    along = points[:, 2]
    near = jnp.abs(rho - radius) < NEAR * radius
    near |= is_better & (jnp.abs(rho - inner) < NEAR * radius)
    rank = jnp.ceil(STRAY * jnp.sum(near, dtype=rho.dtype)).astype(jnp.int32)
    high, low = (
        largest_of(along, near, rank, most),
        -largest_of(-along, near, rank, most),
    )
    is_long = is_better & (high > low) & jnp.isfinite(high - low)
    half = body.height / 2
    low, high = jnp.where(is_long, low, -half), jnp.where(is_long, high, half)
    # The end that faces the camera, and what of it is seen beside the wall.
    faces = jnp.where(jnp.sum(body.center * body.axis) > 0, low, high)
    on_end = jnp.abs(along - faces) < 0.1 * (high - low)
    on_end &= rho < (1 - NEAR) * radius
    nearest = -largest_of(-rho, on_end, jnp.zeros((), jnp.int32), 1)
    of_end = jnp.where(jnp.any(on_end), 0.8 * nearest, UNSEEN * radius)
    inner = jnp.where(is_better, inner, of_end)
    across = jnp.append(middle, (low + high) / 2)
    return TubeBody(
        center=body.center + across @ frame,
        axis=body.axis,
        radius=radius,
        inner_radius=jnp.clip(inner, LEAST * radius, MOST * radius),
        height=high - low,
    )


def _circles(
    points: Float[Array, "n 2"], outside: Bool[Array, " n"], inside: Bool[Array, " n"]
) -> tuple[Float[Array, "2"], Float[Array, ""], Float[Array, ""]]:
    """Center and radii of two circles about it, by least squares; 0 or NaN if none.

    |x|^2 = 2 c.x + (r^2 - |c|^2) is linear in the center and one number for each. They
    are fitted once more to the points that lie close.
    """
    scale = jnp.maximum(jnp.max(jnp.abs(points)), jnp.finfo(points.dtype).tiny)
    x = points / scale
    squares = jnp.sum(x * x, axis=1)

    def fitted(outside: Array, inside: Array) -> tuple[Array, Array, Array]:
        of_each = jnp.stack([outside, inside], axis=1).astype(x.dtype)
        rows = jnp.concatenate([2 * x, of_each], axis=1)
        rows = jnp.where((outside | inside)[:, None], rows, 0)
        equations = rows.T @ rows
        equations += eps(x.dtype, 4) * len(x) * jnp.eye(4, dtype=x.dtype)
        solution = jax.scipy.linalg.solve(equations, rows.T @ squares, assume_a="pos")
        center = solution[:2]
        radii = jnp.sqrt(jnp.maximum(solution[2:] + jnp.sum(center**2), 0))
        return center, radii[0], radii[1]

    center, outer, inner = fitted(outside, inside)
    rho = jnp.sqrt(jnp.sum((x - center[None]) ** 2, axis=1))
    kept = []
    for among, radius in ((outside, outer), (inside, inner)):
        miss = jnp.abs(rho - radius)
        limit = 3 * 1.4826 * median_of(miss, among) + eps(x.dtype, 16)
        kept.append(among & (miss <= limit))
    center, outer, inner = fitted(*kept)
    return center * scale, outer * scale, inner * scale
