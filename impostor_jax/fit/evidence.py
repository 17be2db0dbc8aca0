"""What a depth image says about a body, as rows of residuals.

Two kinds of evidence. Every reading of the object tells the depth of its surface. And
every place at the region's edge where the image shows that the object stops (background
behind it, or the edge of a mask that is the silhouette) tells where the outline passes:
between the centers of two neighboring pixels. An occluder in front, and a missing
reading, say nothing.
"""

__all__ = [
    "MAX_CROSSINGS",
    "Pixels",
    "crossing_rows",
    "deviation",
    "gather_edge",
    "gather_pixels",
    "joined",
    "reading_rows",
]

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.fit.body import AbstractBody, SurfaceSeen
from impostor_jax.fit.residuals import held, surface_seen
from impostor_jax.fit.rows import Kind, Rows
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps, safe_divide, safe_sqrt
from impostor_jax.sensor.base import AbstractDepthNoise

MAX_CROSSINGS = 512
"""Most pixels at the object's edge that are looked at, spread over all of it."""

GRAZING = 4.0
"""Half-chord, in deviations of a reading, below which it is compared in squares.

From there on the bend of the square root moves a reading's expectation by less than
1/32 of its deviation.
"""

OUTLIER = 10.0
"""Deviations beyond which a reading is not squared, which would make it a lever."""

FOLD = 3.0
"""Deviations by which a grazing reading may lie behind the nearest approach by chance;
one that lies farther back says that its ray misses the wall."""

SETTLED_PLACE = 0.05
"""Softness, in pixels, up to which an estimate tells which readings are the body's."""

OWN_VOTES = 4.0
"""Neighbors with background that one on the body itself outweighs at an end."""

FARTHEST_CROSSING = 30.0
"""Pixels from the predicted outline beyond which a crossing is not the body's."""


class Pixels(eqx.Module):
    """What the image holds at some pixels.

    Attributes:
        direction: Of the rays, in the camera frame, with z = 1.
        depth: In meters; 0 where there is no reading.
        exists: False beyond the image, and for entries that only fill up.
    """

    direction: Vec3
    depth: Float[Array, "*batch"]
    exists: Bool[Array, "*batch"]


def gather_pixels(
    depth: Float[Array, "h w"],
    camera: AbstractCamera,
    row: Int[Array, "*batch"],
    col: Int[Array, "*batch"],
) -> Pixels:
    """Collect what the image holds at some pixels; beyond it there is no reading."""
    exists = _in_image(row, col, depth.shape)
    row, col = jnp.where(exists, row, 0), jnp.where(exists, col, 0)
    return Pixels(
        direction=camera.rays(row, col, depth.dtype).direction,
        depth=jnp.where(exists, depth[row, col], 0),
        exists=exists,
    )


def gather_edge(
    depth: Float[Array, "h w"],
    mask: Bool[Array, "h w"],
    camera: AbstractCamera,
    row: Int[Array, " n"],
    col: Int[Array, " n"],
) -> tuple[Pixels, Bool[Array, "5 m"]]:
    """Collect what the image holds at the object's edge.

    Args:
        depth: In meters; 0 where there is no reading.
        mask: Pixels of the object.
        camera: The camera.
        row: Rows of the object's pixels; one beyond the image only fills up.
        col: Columns of the object's pixels.

    Returns:
        Pixels of the object at its edge with their neighbors: itself, left, right,
        above and below; and which of them belong to the object.
    """
    down, right = jnp.array([[0, 0, 0, -1, 1], [0, -1, 1, 0, 0]])[..., None]
    near_row, near_col = row[None] + down, col[None] + right
    exists = _in_image(near_row, near_col, depth.shape)
    inside = mask.at[near_row, near_col].get(mode="clip")
    is_edge = exists[0] & jnp.any(exists & ~inside, axis=0)
    # A fixed shuffle, so that the pixels that are kept lie all around the object.
    order = np.random.default_rng(0).uniform(0.5, 1, row.shape[0])
    priority = jnp.where(is_edge, jnp.asarray(order, depth.dtype), 0)
    priority, chosen = jax.lax.top_k(priority, min(MAX_CROSSINGS, row.shape[0]))
    edge_row = jnp.where((priority > 0)[None], near_row[:, chosen], -1)
    return gather_pixels(depth, camera, edge_row, near_col[:, chosen]), inside[
        :, chosen
    ]


def _in_image(
    row: Int[Array, "*batch"], col: Int[Array, "*batch"], shape: tuple[int, ...]
) -> Bool[Array, "*batch"]:
    return (row >= 0) & (row < shape[0]) & (col >= 0) & (col < shape[1])


def deviation(
    noise: AbstractDepthNoise,
    depth: Float[Array, "*batch"],
    cos_incidence: Float[Array, "*batch"],
) -> Float[Array, "*batch"]:
    """What the sensor says, but no less than depths are rounded to."""
    return jnp.maximum(noise.sigma(depth, cos_incidence), eps(depth.dtype, 4) * depth)


def reading_rows(
    pixels: Pixels,
    seen: SurfaceSeen,
    noise: AbstractDepthNoise,
    soft: Float[Array, ""],
) -> Rows:
    """One row for each reading, weighed as the sensor errs.

    Args:
        pixels: Pixels of the object.
        seen: What they see of the current estimate. The weights come from it and not
            from the readings, whose errors they would follow.
        noise: Of the sensor.
        soft: Half-chord in meters up to which the outline is blunted, so that a solver
            can move it across pixels; where it is less than `GRAZING` deviations, no
            reading is blunted and grazing ones are compared in squares.
    """
    # An estimate that is far off must not have its rows weighed as if it were right.
    used = pixels.depth > 0
    near = jnp.clip(seen.depth, pixels.depth / 2, 2 * pixels.depth)
    sigma = deviation(noise, jnp.where(used, near, 1), seen.cos_incidence)
    coarse = soft > GRAZING * sigma
    # How far in front of the nearest approach the reading lies, or behind from inside.
    reach = jnp.where(seen.outside, 1.0, -1.0) * (seen.nearest - pixels.depth)
    half = safe_sqrt(seen.square)
    grazing = (seen.square < (GRAZING * sigma) ** 2) & ~seen.on_cap & ~coarse
    grazing &= jnp.abs(reach - half) < OUTLIER * sigma
    # The deviation of the difference of squares, over twice sigma.
    chord = jnp.sqrt(half * half + sigma * sigma / 2)
    # Its square, or less where it is too far behind the axis to be there by chance.
    fold = FOLD * sigma
    square = jnp.where(reach < -fold, fold * (2 * reach + 3 * fold), reach * reach)
    blank = jnp.zeros_like(sigma)
    return Rows(
        direction=pixels.direction,
        kind=jnp.where(grazing, int(Kind.SQUARE), int(Kind.DEPTH)),
        end=blank,
        side=blank,
        target=jnp.where(grazing, square - sigma * sigma, pixels.depth),
        weight=jnp.where(used, 1 / sigma, 0),
        slack=blank,
        nearest=seen.nearest,
        half=half,
        chord=jnp.where(grazing, chord, jnp.where(coarse, soft, sigma)),
    )


def crossing_rows(
    around: tuple[Pixels, Bool[Array, "5 m"]],
    body: AbstractBody,
    noise: AbstractDepthNoise,
    is_outline: bool,
    place: Float[Array, ""],
    always: bool | Bool[Array, ""] = True,
) -> Rows:
    """One row for each pixel at the edge where the image shows that the object stops.

    The outline is where one of a body's margins passes 0: a ray misses the wall, the
    end that faces away, or the end that faces the camera. Each is positive outside, so
    the largest, in pixels, is the signed distance from the outline and tells what a
    pixel of the region and its neighbor outside have between them. They are compared
    along the image direction that crosses it more steeply.

    An end's place is uniform between the two pixels and independent from row to row:
    its deviation is 1/sqrt(12) px. The wall's edge is straight, so along an image
    direction all rows may have the same place in the grid: there the interval alone
    counts, and all within it are as likely. It counts where the region is an outline;
    that every pixel of a region must be hit would push one way only, and bias a radius
    by up to its deviation.

    Args:
        around: As `gather_edge` returns it.
        body: Current estimate, in the camera frame.
        noise: Of the sensor.
        is_outline: Whether the region's edge is the silhouette, readings or not.
        place: Softness, in pixels, of the walls of an interval in which the wall's edge
            lies: small, but an estimate that is off needs more.
        always: As in `held`.
    """
    r = body.radius
    edge, in_region = around
    seen = held(always, lambda: surface_seen(edge.direction, body, r / 10))
    near = -jnp.sign(seen.slope[0])
    margins = body.margins(seen)
    kinds = margins.shape[0]
    gap, middle = margins[:, 1:] - margins[:, :1], (margins[:, 1:] + margins[:, :1]) / 2
    steep = jnp.abs(gap)
    across = jnp.maximum(steep[:, :2].max(axis=1), steep[:, 2:].max(axis=1))
    off = safe_divide(middle, gap)
    away = edge.depth - seen.nearest
    # In front of the axis by more than the radius, in depth, is in front of the wall.
    reach = 5 * noise.sigma(edge.depth, jnp.ones_like(edge.depth))
    reach = jnp.maximum(reach, r / 10)
    has = edge.depth > 0
    # A region may stop short of the object: beyond its axis lies the far half of its
    # own cap, too. And it may go on past it: then the object stops elsewhere.
    own = 5 * deviation(noise, jnp.where(has, edge.depth, 1), seen.cos_incidence)
    is_own = has & (jnp.abs(edge.depth - seen.depth) < own)
    behind = has & (away > reach) & ~is_own
    occluder = has & (away < -jnp.sqrt(jnp.maximum(seen.square, r * r)) - reach)
    outside = edge.exists & ~in_region
    shown = outside & (~occluder if is_outline else behind)
    # An estimate that is still off does not tell.
    is_body = is_own | ~has | (place > SETTLED_PLACE)
    inside = edge.exists[None, :1] & seen.outside[None, :1] & is_body[None, :1]
    # The steeper direction, whose two neighbors differ by rounding.
    steepest = gap >= (1 - 1e-3) * across[:, None]
    valid = outside[None, 1:] & inside & steepest & (gap > 0)
    valid &= jnp.abs(off) < FARTHEST_CROSSING
    # Beside the wall's edge its two points have no place along the axis.
    central = (seen.square > 0.2 * (r * r)) & seen.outside
    is_end = (np.arange(kinds) > 0)[:, None, None]
    valid &= ~is_end | (central[:1] & central[1:])[None]
    score = jnp.where(valid, off, -jnp.inf).reshape(4 * kinds, -1)
    # The first of the best, in 15 us where `argmax` takes 40: counted in floating
    # point, since XLA does not vectorize minima of whole numbers.
    number = jnp.arange(4 * kinds, dtype=r.dtype)[:, None]
    is_best = score == jnp.max(score, axis=0)[None]
    best = jnp.min(jnp.where(is_best, number, 4 * kinds), axis=0)
    chosen = best[None] == number

    def pick(values: Array) -> Array:
        full = jnp.broadcast_to(values, (kinds, 4, values.shape[-1])).reshape(
            4 * kinds, -1
        )
        return jnp.sum(jnp.where(chosen, full, 0), axis=0)

    crosses = jnp.any(jnp.isfinite(score), axis=0)
    step = jnp.where(crosses, pick(gap), 1)
    # Four neighbors of each margin, of which the first is the wall's.
    is_wall = best < 4
    side = jnp.where(best < 8, -1.0, 1.0).astype(r.dtype)
    end = jnp.where(is_wall, 0, side * near)
    zero = jnp.zeros_like(step)
    shows = pick(jnp.where(shown, 1, 0).astype(r.dtype)[None, 1:])
    # Where most neighbors beyond an end are no background, the object goes on, and the
    # few that are err. A neighbor on the body itself says so by more than a majority:
    # at the edge of a region that stops short, half may be mixed with what is behind.
    says = jnp.where(is_own, OWN_VOTES, jnp.where(has, 1.0, 0.0)).astype(r.dtype)
    reads = pick(says[None, 1:])
    votes = jnp.where(shows > 0, shows, -reads)
    ends = jnp.array([-1, 1], r.dtype)[:, None]
    total = jnp.sum(jnp.where(end[None] == ends, votes[None], 0), axis=1)
    elected = jnp.any((end[None] == ends) & (total > 0)[:, None], axis=0)
    counts = crosses & (shows > 0) & jnp.where(is_wall, is_outline, elected)
    precision = jnp.where(is_wall, 1 / place, 12**0.5)
    return Rows(
        direction=jax.tree.map(
            lambda field: pick((field[1:] + field[:1])[None]) / 2, edge.direction
        ),
        kind=jnp.where(is_wall, int(Kind.WALL), int(Kind.END)),
        end=end,
        side=side,
        target=zero,
        weight=jnp.where(counts, precision / step, 0),
        slack=jnp.where(is_wall, step / 2, 0),
        nearest=zero,
        half=zero,
        chord=zero + r / 10,
    )


def joined(*parts: Rows) -> Rows:
    """Put rows one after the other."""
    return jax.tree.map(lambda *fields: jnp.concatenate(fields), *parts)
