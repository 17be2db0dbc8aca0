"""What a depth image says about a body, as terms of a whitened residual vector.

Two kinds of evidence. Every reading of the object tells the depth of its surface. And
every place at the region's edge where the image shows that the object stops (background
behind it, or the edge of a mask that is the silhouette) tells where the outline passes:
between the centers of two neighboring pixels. An occluder in front, and a missing
reading, say nothing.

A reading is compared with the depth of the surface along its own ray: sensors err along
the ray, and the orthogonal distance is biased then (a radius of 20 mm comes out 0.97 mm
too small at 3 mm noise and 1 m).

Depth leaves the wall's nearest approach n by the half-chord h = sqrt(q), and q, not h,
is smooth where a ray grazes the wall. There a reading y is compared in squares: of
(n - y)^2 - sigma^2 the expectation is q whatever the noise, and its variance is
4 q sigma^2 + 2 sigma^4. So the estimate has no bias from the bend of the square root, a
grazing pixel counts for what it tells, and the outline can move across pixels. What is
read follows n along the estimate's own h: along the reading's, its error would enter
the gradient, and bias it.

All is read anew at every estimate, its weights included; a fit ends where a step from
there leads nowhere.
"""

__all__ = [
    "Readings",
    "Terms",
    "crossing_terms",
    "joined_readings",
    "joined_terms",
    "reading_terms",
    "readings_of",
]

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.compiling import computed_once
from impostor_jax.fit.body import AbstractBody, Passing, Rays
from impostor_jax.fit.moved_rays import GRAZING, OUTLIER, moved_rays
from impostor_jax.fit.problem import Edge, Pixels, Problem, View, sigma_of
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers, safe_divide, safe_sqrt
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.bias import Bias, is_none
from impostor_jax.sensor.matching_window import STEEPEST

FOLD = 3.0
"""Standard deviations by which a grazing reading may lie behind the nearest approach by
chance; one that lies farther back says that its ray misses the wall."""

SQUARE_WIDTH = 4.0
"""Factor on the width of the robust loss where readings are compared in squares: their
error is skewed, and a loss that bends early would be biased."""

MISSED = 6.0
"""How far a ray misses the wall, as a half-chord's square in variances of a reading,
where that width is halved. No error of a reading leads there, and what is read as far
away as the limb is mixed with what is behind it: two such readings beside a can's
outline moved that by half a pixel, and its radius by ten deviations. Beside a wall that
is no circle rays miss as far: with 4 one of 12 fits to ovals of 4 and 5 % was five
deviations off, and with 16 three of 20 to cans of many pixels, of which one in twenty
beside the outline was mixed."""

FIRST_END_WIDTH = 20.0
"""The same for ends that may still be pixels off."""

SETTLED_PLACE = 0.05
"""Softness, in pixels, up to which an estimate tells which readings are the body's."""

LEAST_COSINE = 0.1
"""Of the incidence, down to which a pixel's footprint on a face grows."""

OWN_VOTES = 4.0
"""Neighbors with background that one on the body itself outweighs at an end."""

CLEAR = 1 / 3
"""Part of the radius, from its outline, beyond which every reading is used."""

BESIDE_EDGE = 1.5
"""Errors across its rays within which a region may stop beside the object: pixels that
see past it are left out, and none is let in that sees it from beyond. An error of half
a pixel moved ends by a third of one, six of their deviations."""

AT_RIM = 3.0
"""Errors across its ray up to which a reading beside a rim may be of either side."""

FARTHEST_CROSSING = 30.0
"""Pixels from the predicted outline beyond which a crossing is not the body's."""


class Terms(eqx.Module):
    """Body less image along some rays, in standard deviations.

    Attributes:
        augmented: The augmented Jacobian, a term a column: the gradient in tangent
            coordinates, and last the residual.
        weight: Inverse of the standard deviation of what is compared; 0 for terms that
            only fill up.
        widening: Factor on the width of the robust loss.
        end: Of a crossing of an end: -1 at `center - axis * height / 2`, 1 at the
            other; 0 for other terms.
    """

    augmented: Float[Array, "k n"]
    weight: Float[Array, " n"]
    widening: Float[Array, " n"]
    end: Float[Array, " n"]

    @property
    def residual(self) -> Float[Array, " n"]:
        """What the estimate leaves."""
        return self.augmented[-1]

    @property
    def gradient(self) -> Float[Array, "c n"]:
        """Its derivative in the tangent coordinates."""
        return self.augmented[:-1]


class Readings(NamedTuple):
    """What readings say of an estimate.

    Attributes:
        terms: One for each.
        passing: How their rays pass the body.
        is_square: Which compare squares.
        used: Which are there, and of one surface.
        follows: By how many deviations a term falls as its reading grows by one: 1, and
            less where it grazes.
        off: Surface less reading, in meters along the ray.
        is_exact: Which were compared along rays that are exact.
    """

    terms: Terms
    passing: Passing
    is_square: Bool[Array, " n"]
    used: Bool[Array, " n"]
    follows: Float[Array, " n"]
    off: Float[Array, " n"]
    is_exact: Bool[Array, " n"]


def reading_terms(
    pixels: Pixels,
    body: AbstractBody,
    noise: AbstractDepthNoise,
    soft: Float[Array, ""] | float = 0.0,
    pixel: Float[Array, ""] | float = 0.0,
    is_image: bool | Bool[Array, ""] = True,
) -> Readings:
    """One term for each reading, weighed as the sensor errs.

    One that may be of two surfaces, or lean, beside the outline of the wall is not
    used, though no jump be seen there: what grazes is a lever, and 1 % of mixed
    readings there, which no robust loss tells from noise, took eleven standard
    deviations off a radius.

    Args:
        pixels: Pixels of the object.
        body: The estimate, in the camera frame. The weights come from it and not from
            the readings, whose errors they would follow.
        noise: Of the sensor.
        soft: Half-chord in radii up to which the outline is blunted, so that a solver
            can move it across pixels; where it is less than `GRAZING` standard
            deviations, no reading is blunted and grazing ones are compared in squares.
        pixel: Distance of neighboring rays over the depth.
        is_image: As of `View`.
    """
    soft = soft * body.radius
    seen = computed_once(lambda: body.passing(pixels.rays, body.radius / 100))
    if body.bends == 1:
        # Readings less than a pixel beyond a face's edge do not pull at it. Otherwise
        # the noise of one column of pixels placed edges that run along it, and an
        # edge was 11 standard deviations off.
        far = jnp.maximum(seen.nearest + seen.foot, 0)
        width = pixel * far / jnp.maximum(seen.cos_incidence, LEAST_COSINE)
        slack = jnp.where(is_image, width, 0)
        seen = eqx.tree_at(
            lambda s: s.overshoot, seen, jnp.maximum(seen.overshoot - slack, 0)
        )
    # An estimate that is far off must not have its terms weighed as if it were right.
    used = (pixels.depth > 0) & _is_clear(seen, body, pixels, noise, pixel)
    if not noise.bias.has_exact_rays:
        used &= ~_is_at_rim(seen, body, pixels, noise)
    near = jnp.clip(seen.depth, pixels.depth / 2, 2 * pixels.depth)
    sigma = computed_once(
        lambda: sigma_of(noise, pixels, jnp.where(used, near, 1), seen.cos_incidence)
    )
    coarse = soft > GRAZING * sigma
    # How far in front of the nearest approach the reading lies, or behind from inside.
    sign = seen.sign
    reach = -sign * (seen.nearest + seen.foot - pixels.depth)
    # Its square, or less where it is too far behind the axis to be there by chance.
    fold = FOLD * sigma
    folded = jnp.where(reach < -fold, fold * (2 * reach + 3 * fold), reach * reach)
    off = seen.depth - pixels.depth
    if noise.bias.has_exact_rays:
        weight = jnp.where(used, 1 / sigma, 0)
        squares = seen.square - folded + sigma * sigma
        chord = safe_sqrt(seen.square)
        grazing = (seen.square < (GRAZING * sigma) ** 2) & ~seen.on_cap & ~coarse
        grazing &= jnp.abs(reach - chord) < OUTLIER * sigma
        steadiness, is_skewed = 1.0, grazing
        missed = jnp.maximum(-seen.square, 0) / (MISSED * sigma * sigma)
        widening = SQUARE_WIDTH / (1 + missed * missed)
    else:
        moved = computed_once(
            lambda: moved_rays(
                pixels, body, noise.bias, seen, sigma, folded, reach, is_image
            )
        )
        weight, squares = jnp.where(used, moved.weight, 0), moved.squares
        steadiness, is_skewed = moved.steadiness, moved.is_skewed
        grazing = ~seen.on_cap & ~coarse
        # A ray that misses has erred.
        widening = SQUARE_WIDTH
        seen = jax.tree.map(partial(jnp.where, grazing), moved.passing, seen)
        chord = safe_sqrt(seen.square)
    # The standard deviation of the difference of squares, over twice sigma.
    per_square = sign / (2 * jnp.sqrt(chord * chord + sigma * sigma / 2))
    blunted = seen.with_chord(jnp.where(coarse, soft, sigma))
    of_wall = jnp.where(seen.on_cap, 1 - seen.plane_weight, 1)
    error = jnp.where(grazing, squares * per_square, blunted.depth - pixels.depth)
    alpha = jnp.where(grazing, 2 * sign * chord * per_square, of_wall)
    beta = jnp.where(
        grazing, per_square * steadiness, sign * of_wall * blunted.half_slope
    )
    gradient = body.of_reading(blunted, alpha, beta, seen.on_cap & ~grazing)
    blank = jnp.zeros_like(weight)
    terms = Terms(
        augmented=_stacked([part * weight for part in (*gradient, error)]),
        weight=weight,
        widening=jnp.where(grazing & is_skewed, widening, 1.0).astype(weight.dtype),
        end=blank,
    )
    follows = jnp.where(grazing, jnp.abs(2 * chord * per_square), 1)
    if not noise.bias.has_exact_rays:
        # The distance along a ray that grazes the wall says little.
        off = jnp.where(grazing, error, off)
    is_exact = jnp.full(used.shape, noise.bias.has_exact_rays)
    return Readings(terms, seen, grazing, used, follows, off, is_exact)


def readings_of(
    problem: Problem,
    bodies: Sequence[AbstractBody],
    noises: Sequence[AbstractDepthNoise],
) -> list[Readings]:
    """What each view's readings say of an estimate, given its noise.

    Args:
        problem: Of the views.
        bodies: The estimate, in the frame of each.
        noises: Of each view.
    """

    def told(view: View, own: AbstractBody, noise: AbstractDepthNoise) -> Readings:
        return reading_terms(
            view.pixels, own, noise, pixel=view.pixel, is_image=view.is_image
        )

    return problem.of_each(told, bodies, noises)


def _is_clear(
    seen: Passing,
    body: AbstractBody,
    pixels: Pixels,
    noise: AbstractDepthNoise,
    pixel: Numbers | float,
) -> Bool[Array, " n"] | bool:
    """Whether rays pass the wall's outline so far off that a reading is of one side.

    Of a thin body, of which few would, those do that pass `CLEAR` of the radius off.
    """
    bias = noise.bias
    if not bias.errs_at_edges:
        return True
    r, inverse = body.radius, jnp.abs(seen.inverse)
    width = pixel * (seen.nearest + seen.foot)
    beside = width * jnp.asarray(bias.edge_reach, r.dtype)
    if not is_none(bias.window_reach):
        beside += width * bias.window_reach * _slant(body, pixels)
        # To a window what is too steep is a jump: beside the outline of x = r the depth
        # changes by x / sqrt((r^2 - x^2) A).
        slope = np.tan(STEEPEST)
        beside += r * (1 - slope * jax.lax.rsqrt(slope**2 + inverse))
    beside = jnp.minimum(beside, CLEAR * r)
    return jnp.abs(seen.square) > seen.square_at(beside, r)


def _is_at_rim(
    seen: Passing, body: AbstractBody, pixels: Pixels, noise: AbstractDepthNoise
) -> Bool[Array, " n"]:
    """Whether a ray passes a cap's rim so closely that it may meet the other side.

    Caps whose readings were told from the wall's by rays that err bent a tilted wall by
    ten deviations of what a cloud of 36,000 points tells. Of a thin body those alone
    that pass less than `CLEAR` of the radius off.
    """
    d = seen.local.direction
    length = jnp.sqrt(d.dot(d))
    # In the plane of the cap, which the ray may meet at a slant.
    slant = jnp.maximum(jnp.abs(d.z) / length, LEAST_COSINE)
    beside = AT_RIM * noise.bias.across_at(pixels.depth * length) / slant
    return seen.is_beside_rim(jnp.minimum(beside, CLEAR * body.radius))


def _slant(body: AbstractBody, pixels: Pixels) -> Float[Array, " n"]:
    """Distance from an outline at which a square window leaves it, in half windows.

    1 where it runs along rows or columns, and up to the root of 2, of its corner.
    """
    direction = pixels.direction
    one, zero = jnp.ones_like(direction.x), jnp.zeros_like(direction.x)

    def across(x: Numbers, y: Numbers) -> Numbers:
        return body.passing(Rays(Vec3(x, y, one), pixels.start)).square

    at = direction.x, direction.y
    _, in_col = jax.jvp(across, at, (one, zero))
    _, in_row = jax.jvp(across, at, (zero, one))
    tiny = jnp.finfo(one.dtype).tiny
    length = jnp.maximum(jnp.hypot(in_col, in_row), tiny)
    return (jnp.abs(in_col) + jnp.abs(in_row)) / length


def crossing_terms(
    edge: Edge,
    body: AbstractBody,
    noise: AbstractDepthNoise,
    is_outline: bool | Bool[Array, ""],
    place: Float[Array, ""] | float,
    is_first: bool | Bool[Array, ""] = False,
) -> Terms:
    """One term for each pixel at the edge where the image shows that the object stops.

    The outline is where one of a body's margins passes 0: a ray misses the wall, the
    end that faces away, or the end that faces the camera; or, within a bore, the wall
    where it ends far away, or the rim beside which it is seen through. Each is positive
    outside, so
    the largest, in pixels, is the signed distance from the outline and tells what a
    pixel of the region and its neighbor outside have between them. They are compared
    along the image direction that crosses it more steeply.

    An end's place is uniform between the two pixels: its standard deviation is
    1/sqrt(12) px. It is independent from one row of pixels to the next where an end
    runs across them, and the same in all where it runs along the grid, as of a box
    before a level camera. A region's edge is no more exact than the sensor: readings
    that mix both sides of a jump are left out of one that was made from readings, all
    along. So there its place is uniform within `edge_reach` and `window_reach` pixels
    of that, too, and within what rays err by, and off by as much in all rows; of an
    outline, within the sensor's `outline` pixels; of a foot, as is told of that.
    The wall's edge is straight, so along an image direction it may have the same place
    in the grid in all of them: there the interval alone counts, and all within it are
    as likely. It counts where the region is an outline; that every pixel of a region
    must be hit would push one way only, and bias a radius by up to its standard
    deviation.

    Args:
        edge: Where the object may stop.
        body: The estimate, in the camera frame.
        noise: Of the sensor.
        is_outline: Whether the region's edge is the silhouette, readings or not.
        place: Softness, in pixels, of the walls of an interval in which the wall's edge
            lies: small, but an estimate that is off needs more.
        is_first: Whether ends may still be pixels off.
    """
    r, pixels = body.radius, edge.pixels
    chord = r / 10
    seen = computed_once(lambda: body.passing(pixels.rays, chord, apart=True))
    outline = body.margins(seen)
    margins, kinds = outline.value, len(outline.value)
    gap, middle = margins[:, 1:] - margins[:, :1], (margins[:, 1:] + margins[:, :1]) / 2
    steep = jnp.abs(gap)
    across = jnp.maximum(steep[:, :2].max(axis=1), steep[:, 2:].max(axis=1))
    off = safe_divide(middle, gap)
    away = pixels.depth - seen.nearest - seen.foot
    # In front of the axis by more than the radius, in depth, is in front of the wall.
    has = pixels.depth > 0
    read = jnp.where(has, pixels.depth, 1)
    reach = 5 * sigma_of(noise, pixels, read, jnp.ones_like(read))
    reach = jnp.maximum(reach, r / 10)
    # A region may stop short of the object: beyond its axis lies the far half of its
    # own cap, too. And it may go on past it: then the object stops elsewhere.
    own = 5 * sigma_of(noise, pixels, read, seen.cos_incidence)
    is_own = has & (jnp.abs(pixels.depth - seen.depth) < own)
    # What is mixed of both is not where the background begins.
    behind = has & (away > reach) & ~is_own & ~edge.mixed
    occluder = has & (away < -jnp.sqrt(jnp.maximum(seen.square, r * r)) - reach)
    outside = pixels.exists & ~edge.inside
    shown = outside & jnp.where(is_outline, ~occluder, behind)
    # An estimate that is still off does not tell.
    is_body = is_own | ~has | (place > SETTLED_PLACE)
    inside = pixels.exists[None, :1] & seen.outside[None, :1] & is_body[None, :1]
    # The steeper direction, whose two neighbors differ by rounding.
    steepest = gap >= (1 - 1e-3) * across[:, None]
    valid = outside[None, 1:] & inside & steepest & (gap > 0)
    valid &= jnp.abs(off) < FARTHEST_CROSSING
    valid &= outline.tells[:, 1:] & outline.tells[:, :1]
    score = jnp.where(valid, off, -jnp.inf).reshape(4 * kinds, -1)
    # The first of the best, counted in floating point, since XLA does not vectorize
    # minima of whole numbers: in 15 us where `argmax` takes 40.
    number = jnp.arange(4 * kinds, dtype=r.dtype)[:, None]
    is_best = score == jnp.max(score, axis=0)[None]
    best = jnp.min(jnp.where(is_best, number, 4 * kinds), axis=0)
    chosen = best[None] == number

    def pick(values: Array) -> Array:
        full = jnp.broadcast_to(values, (kinds, 4, values.shape[-1]))
        return jnp.sum(jnp.where(chosen, full.reshape(4 * kinds, -1), 0), axis=0)

    crosses = jnp.any(jnp.isfinite(score), axis=0)
    step = jnp.where(crosses, pick(gap), 1)
    # Four neighbors of each margin, of which the first is the wall's.
    is_wall = best < 4
    kind = jnp.floor(best / 4)[None] == jnp.arange(kinds, dtype=r.dtype)[:, None]
    side = jnp.asarray(outline.side, r.dtype)[:, None]
    end, side, line = (
        jnp.sum(jnp.where(kind, values, 0), axis=0)
        for values in (outline.end, side, outline.line)
    )
    shows = pick(jnp.where(shown, 1, 0).astype(r.dtype)[None, 1:])
    # Where most neighbors beyond an end are no background, the object goes on, and the
    # few that are err. A neighbor on the body itself says so by more than a majority:
    # at the edge of a region that stops short, half may be mixed with what is behind.
    says = jnp.where(is_own, OWN_VOTES, jnp.where(has, 1.0, 0.0)).astype(r.dtype)
    reads = pick(says[None, 1:])
    votes = jnp.where(shows > 0, shows, -reads)
    same = line[None] == jnp.array(outline.lines, r.dtype)[:, None]

    def of_all(values: Float[Array, " m"]) -> Float[Array, " m"]:
        # Their sum over all crossings of the same line. What a mask leaves out of a
        # bore says nothing of the ends outside.
        totals = jnp.sum(jnp.where(same, values[None], 0), axis=1)
        return jnp.sum(jnp.where(same, totals[:, None], 0), axis=0)

    # Beside a rim the outline is neither straight nor the wall's.
    is_wall_part = np.arange(kinds)[:, None, None] == 0
    in_length = (margins[:, 1:] < 0) & (margins[:, :1] < 0)
    in_length = jnp.all(in_length | is_wall_part, axis=0)
    is_straight = pick(jnp.where(in_length, 1, 0).astype(r.dtype)[None]) > 0
    counts = crosses & (shows > 0)
    counts &= jnp.where(is_wall, is_straight & is_outline, of_all(votes) > 0)
    # What all rows share does not average out: it counts as often as there are rows.
    ones = jnp.where(counts, 1, 0).astype(r.dtype)
    alike = of_all(ones)
    in_phase = _in_phase(pick(off), ones, best % 4 < 2, of_all)
    bias = noise.bias
    of_region, of_outline = (
        jnp.asarray(reach, r.dtype)
        for reach in (bias.edge_reach + bias.window_reach, bias.outline)
    )
    if not bias.has_exact_rays:
        of_region += BESIDE_EDGE * _across_in_pixels(pixels, bias)
    shared = jnp.where(is_outline, of_outline, of_region)
    # A sensor mixes nothing where no depth jumps.
    shared = jnp.where(edge.foot < 0, shared, edge.foot)
    if bias.lean is not None:
        # All within are as likely, with that standard deviation.
        shared += 3**0.5 * jnp.asarray(bias.lean, r.dtype)
    of_ends = (1 + in_phase + alike * 4 * shared**2) / 12
    variance = jnp.where(is_wall, alike * place**2, of_ends)
    weight = jnp.where(counts, jax.lax.rsqrt(jnp.where(counts, variance, 1)) / step, 0)

    between = jax.tree.map(
        lambda field: pick((field[1:] + field[:1])[None]) / 2, pixels.rays
    )
    passing = computed_once(lambda: body.passing(between, chord))
    error, gradient = body.of_end(passing, end, side)
    zero = jnp.zeros_like(error)
    of_wall = body.of_reading(passing, zero, zero - 1, jnp.zeros(zero.shape, bool))
    error = jnp.where(is_wall, -passing.square, error)
    slack = jnp.where(is_wall, step * (0.5 + shared), 0)
    beyond = jnp.maximum(jnp.abs(error) - slack, 0)
    pulls = jnp.where(jnp.abs(error) < slack, 0, weight)
    of_place = [
        jnp.where(is_wall, own, of) * pulls
        for own, of in zip(of_wall, gradient, strict=True)
    ]
    end_width = jnp.where(is_first, FIRST_END_WIDTH, 1.0)
    return Terms(
        augmented=_stacked([*of_place, jnp.sign(error) * beyond * weight]),
        weight=weight,
        widening=jnp.where(is_wall, 1.0, end_width).astype(r.dtype),
        end=end,
    )


def _across_in_pixels(pixels: Pixels, bias: Bias) -> Float[Array, " m"]:
    """Error across its ray of each reading at an edge, over the distance of rays."""
    d = pixels.direction
    aside = [jnp.abs(x[1:] - x[:1]) for x in (d.x, d.y, d.z)]
    width = jnp.max(jnp.hypot(jnp.hypot(aside[0], aside[1]), aside[2]), axis=0)
    depth = pixels.depth[0]
    across = bias.across_at(depth * jnp.sqrt(d.dot(d)[0]))
    return safe_divide(across, width * depth)


def _in_phase(
    place: Float[Array, " m"],
    counts: Float[Array, " m"],
    in_row: Bool[Array, " m"],
    of_all: Callable[[Float[Array, " m"]], Float[Array, " m"]],
) -> Float[Array, " m"]:
    """How many other crossings share the error of each, since a line is along the grid.

    An end along rows or columns has the same place in the grid in all of them. The
    resultant of these places, as angles, tells: 1 of equal ones, 0 of a whole period.

    Args:
        place: Where lines cross, from the middle between two pixels, over their
            distance.
        counts: 1 for those that count, 0 for the others.
        in_row: Whether the two are side by side, and not one above the other.
        of_all: Sum over all crossings of the same line.
    """

    def of_alike(values: Float[Array, " m"]) -> Float[Array, " m"]:
        rows, cols = jnp.where(in_row, values, 0), jnp.where(in_row, 0, values)
        return jnp.where(in_row, of_all(rows), of_all(cols))

    angle = 2 * np.pi * jnp.where(counts > 0, place, 0)
    of_cos, of_sin = (of_alike(counts * x) for x in (jnp.cos(angle), jnp.sin(angle)))
    # Of n independent places the square is 1 / n.
    square = (of_cos**2 + of_sin**2) / jnp.maximum(of_alike(counts), 1)
    return jnp.maximum(square - 1, 0)


def joined_terms(
    terms: Sequence[Terms], views: Sequence[View], body: AbstractBody
) -> Terms:
    """Terms of several views, one after the other, in coordinates of the estimate.

    Args:
        terms: Of each view, as its own body has them.
        views: The views.
        body: In the frame of the first.
    """
    told = [
        eqx.tree_at(lambda t: t.augmented, own, view.told(own.augmented, body))
        for own, view in zip(terms, views, strict=True)
    ]
    return jax.tree.map(lambda *parts: jnp.concatenate(parts, axis=-1), *told)


def joined_readings(
    readings: Sequence[Readings], views: Sequence[View], body: AbstractBody
) -> Readings:
    """The same of what readings say."""
    if len(views) == 1 and views[0].from_shared is None:
        return readings[0]
    terms = joined_terms([own.terms for own in readings], views, body)
    # Rays of one view begin in one plane.
    told = [
        eqx.tree_at(
            lambda r: (r.terms, r.passing.foot),
            own,
            (None, jnp.broadcast_to(own.passing.foot, own.used.shape)),
        )
        for own in readings
    ]
    together = jax.tree.map(lambda *parts: jnp.concatenate(parts), *told)
    return together._replace(terms=terms)


def _stacked(parts: list[Float[Array, " n"]]) -> Float[Array, "k n"]:
    """`jnp.stack` of arrays that are computed.

    Written one after the other: XLA does not vectorize a loop over all of them.
    """
    full = jnp.zeros((len(parts), *parts[0].shape), parts[0].dtype)
    for number, part in enumerate(parts):
        full = jax.lax.dynamic_update_index_in_dim(full, part, number, 0)
    return full
