"""Whether readings are of another wall than the one about an axis that was fitted.

Two cans in one mask, one on the other, are fitted by a cylinder between them, with
residuals of a few deviations and a departure that grows its deviations. A wall that is
cut in two, each part with a radius and an axis of its own, explains them far better; a
cone, an oval, a barrel and a bent tube are explained better without a cut.

Of a cone or an oval in turn some part looks like a cylinder. Left out, the rest seems
to be what a mask holds beside an object; but a wall that departs explains it.
"""

__all__ = [
    "ALONG",
    "FACING",
    "FEWEST",
    "WITHIN",
    "Solution",
    "Split",
    "WallReadings",
    "about_axis",
    "best_split",
    "departs_beyond",
    "departures",
    "refuted_by_seam",
    "solved",
    "wall_readings",
    "wall_terms",
]

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.fit.gather import ray_list
from impostor_jax.fit.pose import in_double
from impostor_jax.fit.regions import sigma_between
from impostor_jax.fit.result import Fit, each_of, is_sure
from impostor_jax.fit.seen import Seen
from impostor_jax.geometry.so3 import directions_across
from impostor_jax.primitives.cylinder import Cylinder

FAR = 3.5
"""Deviations beyond which a reading has little weight."""

BINS = 32
"""Places where two walls may meet."""

FEWEST_BINS = 3
"""Those in which readings of either lie, at least: a ring may lie in two."""

FEWEST = 20
"""Readings that a wall takes."""

LEAST = 0.1
"""Part of the readings that either of two walls has at least."""

PRICE = 50.0
"""Chi-squared of independent readings by which two walls must be better than one that
departs in six patterns. Of 28 stacks of cans, 1 : 0.9 and 1 : 0.95, they are by 190 and
more; of cylinders, cones, ellipses and real cans by 12 at most."""

LEAST_HALF = 0.2
"""Part of the readings that the smaller of two walls has where one is refuted: a fit is
of the body of a can whose neck has less."""

WITHIN = 0.3
"""Part of the radius by which readings of a wall are off it at most."""

ALONG = 0.95
"""Half heights from the middle up to which readings are of the wall alone."""

FACING = 0.2
"""Cosine of the incidence from which on they are: nearer to the outline they are of
more than one surface."""

BEYOND = 3.0
"""Half heights from the middle within which what was left out may be of the wall."""

LEAST_CUT = 0.1
"""Part of the readings that must have been left out; the neck of a can is less."""

LEAST_EXPLAINED = 0.55
"""Part of these that a wall explains that departs. Of 24 masks that were 3 and 6 pixels
too large, and of 6 with a handle, it does at most half; of cones and ovals that were
fitted to less 0.62 and more."""

SIGNIFICANT = 4.0
"""Deviations by which that wall departs in some pattern, at least."""

PER_CELL = (50, 200, 800)
"""Readings in each of the cells, on the mean, that tell how many share an error: those
of smooth errors are as many as these are long."""

FEWEST_CELLS = 16
"""Cells of a size that tell it."""


class Solution(NamedTuple):
    """Of linear equations, most of whose rows are right.

    Attributes:
        value: The unknowns.
        deviation: Of these.
        rest: What is left of each row, in deviations.
        scatter: Of that; 1 where it is less.
    """

    value: Float[np.ndarray, " m"]
    deviation: Float[np.ndarray, " m"]
    rest: Float[np.ndarray, " n"]
    scatter: float


class Split(NamedTuple):
    """Two walls that explain readings as well as any two that meet.

    Attributes:
        place: Where they meet along the axis.
        alone: Chi-squared of one wall.
        smooth: Of one that departs as it likes.
        halves: Of the two.
        rest: What these leave of each reading, in deviations.
        smaller: Part of the readings that the smaller one has.
    """

    place: float
    alone: float
    smooth: float
    halves: float
    rest: Float[np.ndarray, " n"]
    smaller: float


def about_axis(
    points: Float[np.ndarray, "n 3"],
    center: Float[np.ndarray, "3"],
    axis: Float[np.ndarray, "3"],
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Places along an axis, distances from it, and unit vectors away from it."""
    off = points - center
    along = off @ axis
    across = off - along[:, None] * axis
    distance = np.sqrt((across**2).sum(axis=1))
    return along, distance, across / np.maximum(distance, 1e-9)[:, None]


def wall_terms(
    place: Float[np.ndarray, " n"],
    out: Float[np.ndarray, "n 3"],
    axis: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "n 5"]:
    """How distances from a wall change with its radius, and with the axis at both ends.

    Args:
        place: Of the readings along the axis, from -1 to 1.
        out: Unit vectors away from the axis.
        axis: A unit vector.
    """
    first, second = directions_across(axis)
    c, s = out @ first, out @ second
    return np.stack([np.ones_like(c), c, s, place * c, place * s], axis=1)


def departures(
    place: Float[np.ndarray, " n"],
    out: Float[np.ndarray, "n 3"],
    axis: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "n 11"]:
    """The same, and how they change as the wall departs; the arguments are the same.

    By taper, barrel, two of an ellipse and two of a bend.
    """
    own = wall_terms(place, out, axis)
    c, s, ends = own[:, 1], own[:, 2], place**2
    others = [place, ends, c * c - s * s, 2 * c * s, ends * c, ends * s]
    return np.column_stack([own, *others])


def solved(
    terms: Float[np.ndarray, "n m"],
    miss: Float[np.ndarray, " n"],
    deviation: Float[np.ndarray, " n"],
) -> Solution:
    """Solve terms @ value = miss, with little weight for rows that are far off.

    With a prior of deviation 1, for what the rows leave open.
    """
    weight, rest = 1 / deviation, miss
    inverse, value = np.eye(terms.shape[1]), np.zeros(terms.shape[1])
    for _ in range(3):
        rows = terms * weight[:, None]
        inverse = np.linalg.inv(rows.T @ rows + np.eye(terms.shape[1]))
        value = inverse @ (rows.T @ (miss * weight))
        rest = (miss - terms @ value) / deviation
        weight = 1 / deviation / (1 + (rest / FAR) ** 2)
    scatter = max(1.4826 * float(np.median(np.abs(rest))), 1.0)
    return Solution(value, scatter * np.sqrt(np.diag(inverse)), rest, scatter)


def best_split(
    place: Float[np.ndarray, " n"], rows: Float[np.ndarray, "n 12"]
) -> Split | None:
    """Two walls that meet, each with five numbers of its own; None without readings.

    By the normal equations of bins along the axis, added up from either end.

    Args:
        place: Along the axis, from -1 to 1.
        rows: `departures` and the distance from the wall, in deviations.
    """
    bins = ((place + 1) / 2 * BINS).astype(int).clip(0, BINS - 1)
    order = np.argsort(bins, kind="stable")
    rows, edges = rows[order], np.searchsorted(bins[order], np.arange(BINS + 1))
    products = np.array([rows[a:b].T @ rows[a:b] for a, b in itertools.pairwise(edges)])
    total = products.sum(axis=0)
    wall = [*range(5), 11]
    whole = total[np.ix_(wall, wall)]

    # Some of either side must be seen, and not as a ring alone, in which places differ
    # by noise that is in the distances, too.
    counts = np.cumsum(np.diff(edges))[2:-3]
    few = np.minimum(counts, len(rows) - counts) < max(FEWEST, LEAST * len(rows))
    full = np.cumsum(np.diff(edges) > 0)
    few |= np.minimum(full, full[-1] - full)[2:-3] < FEWEST_BINS
    if few.all():
        return None
    before = np.cumsum(products[:, wall][:, :, wall], axis=0)[2:-3]
    value, left = _least(np.stack([before, whole - before]))
    halves = np.where(few, np.inf, left.sum(axis=0))
    best = int(np.argmin(halves))
    rest = np.empty(len(rows))
    cut = edges[best + 3]
    for part, own in ((np.s_[:cut], value[0, best]), (np.s_[cut:], value[1, best])):
        rest[order[part]] = rows[part, 11] - rows[part, :5] @ own
    return Split(
        place=2 * (best + 3) / BINS - 1,
        alone=float(_least(whole)[1]),
        smooth=float(_least(total)[1]),
        halves=float(halves[best]),
        rest=rest,
        smaller=float(min(counts[best], len(rows) - counts[best]) / len(rows)),
    )


def _least(
    products: Float[np.ndarray, "*b m m"],
) -> tuple[Float[np.ndarray, "*b k"], Float[np.ndarray, "*b"]]:
    """Solution of normal equations, whose last row is data, and its chi-squared."""
    size = products.shape[-1] - 1
    equations = products[..., :size, :size] + 1e-6 * np.eye(size)
    right = products[..., :size, size]
    value = np.linalg.solve(equations, right[..., None])[..., 0]
    return value, np.asarray(products[..., size, size] - (right * value).sum(axis=-1))


class WallReadings(NamedTuple):
    """Of a wall: places along it, unit vectors away from its axis, and distances."""

    place: Float[np.ndarray, " n"]
    out: Float[np.ndarray, "n 3"]
    miss: Float[np.ndarray, " n"]
    deviation: Float[np.ndarray, " n"]


def refuted_by_seam(fit: Fit, seen: Sequence[Seen]) -> Fit:
    """The fit, or a failed one where two walls explain what one is fitted to.

    Only where it has doubts.

    Args:
        fit: Concrete and single.
        seen: The object in each of its images.
    """
    body = fit.shape
    if not (isinstance(body, Cylinder) and fit.is_shape) or is_sure(fit):
        return fit
    axis = np.asarray(body.axis, float)
    regions = each_of(fit.region)
    parts = [
        wall_readings(body, one, np.asarray(region))
        for one, region in zip(seen, regions, strict=True)
    ]
    place, out, miss, deviation = map(np.concatenate, zip(*parts, strict=True))
    if len(place) < FEWEST:
        return fit
    terms = departures(place, out, axis)
    smooth = solved(terms, miss, deviation)
    kept = np.abs(smooth.rest) < FAR * smooth.scatter
    place, terms = place[kept], terms[kept]
    rows = np.column_stack([terms, miss[kept]]) / deviation[kept, None]
    split = best_split(place, rows)
    if split is None:
        return fit
    repeats = _repeats(place, terms[:, 1], terms[:, 2], split.rest)
    price = PRICE * repeats * max(split.halves / len(place), 1)
    if split.smaller < LEAST_HALF or split.smooth - split.halves < price:
        return fit
    off = 1e3 * (split.place * float(body.height) / 2)
    return fit.contradicted(
        "the readings are of two walls that meet, "
        f"{abs(off):.0f} mm from the middle: fit each by itself."
    )


def departs_beyond(
    body: Cylinder,
    seen: Sequence[Seen],
    kept: Sequence[Bool[np.ndarray, "h w"]],
) -> bool:
    """Whether most that was left out is of a wall with the rest, which departs.

    Args:
        body: The wall that was fitted.
        seen: The object in each of its images.
        kept: Pixels of each that it was fitted to.
    """
    read = [one.region & (one.image > 0) for one in seen]
    cut = [there & ~own for there, own in zip(read, kept, strict=True)]
    num_cut = sum(map(np.count_nonzero, cut))
    if num_cut < LEAST_CUT * sum(map(np.count_nonzero, read)):
        return False
    inner = [
        wall_readings(body, one, there & own)
        for one, there, own in zip(seen, read, kept, strict=True)
    ]
    outer = [
        wall_readings(body, one, left, BEYOND)
        for one, left in zip(seen, cut, strict=True)
    ]
    parts = zip(*inner, *outer, strict=True)
    place, out, miss, deviation = map(np.concatenate, parts)
    if len(place) < FEWEST:
        return False
    reach = max(1.0, np.abs(place).max())
    terms = departures(place / reach, out, np.asarray(body.axis, float))
    found = solved(terms, miss, deviation)
    first = sum(len(part.place) for part in inner)
    explained = np.abs(found.rest[first:]) < FAR * found.scatter
    departs = np.abs(found.value[5:]) > SIGNIFICANT * found.deviation[5:]
    return bool(
        np.count_nonzero(explained) > LEAST_EXPLAINED * num_cut and departs.any()
    )


def wall_readings(
    body: Cylinder,
    seen: Seen,
    region: Bool[np.ndarray, "h w"],
    reach: float = ALONG,
) -> WallReadings:
    """Readings of a wall, without those near its outline.

    Args:
        body: The wall.
        seen: An image.
        region: Pixels of it.
        reach: Half heights from the middle within which readings are.
    """
    row, col = np.nonzero(region & (seen.image > 0))
    rays = ray_list(seen.image, seen.camera, row, col, seen.noise)
    depth = np.asarray(rays.depth, float)
    view = rays.directions()
    points = view * depth[:, None]
    if rays.start is not None:
        points += rays.start
    rotation, translation = in_double(seen.camera.camera_from_world)
    points, view = (points - translation) @ rotation, view @ rotation
    radius, half = float(body.radius), float(body.height) / 2
    center = np.asarray(body.center, float)
    along, distance, out = about_axis(points, center, np.asarray(body.axis, float))
    # Of the depth; the ray is as long as it is steep.
    cosine = np.abs((out * view).sum(axis=1))
    sigma = sigma_between(seen.noise, depth)
    told = (cosine > FACING * np.sqrt((view**2).sum(axis=1))) & (sigma > 0)
    place, miss = along / half, distance / radius - 1
    told &= (np.abs(place) < reach) & (np.abs(miss) < WITHIN)
    # Where a wall is looked along, errors put readings of its cap beside it.
    stray = FAR * sigma * np.abs(view @ np.asarray(body.axis, float))
    told &= np.abs(np.abs(along) - half) > stray
    deviation = sigma * cosine / radius
    return WallReadings(place[told], out[told], miss[told], deviation[told])


def _repeats(
    place: Float[np.ndarray, " n"],
    cos: Float[np.ndarray, " n"],
    sin: Float[np.ndarray, " n"],
    rest: Float[np.ndarray, " n"],
) -> float:
    """How many readings share an error, by the means of those beside each other.

    Args:
        place: Along the axis, from -1 to 1.
        cos: Of their angle about it.
        sin: Likewise.
        rest: Their residuals.
    """
    angle = np.arctan2(sin, cos) / np.pi + 1
    most = 1.0
    for size in PER_CELL:
        side = max(int(np.sqrt(len(place) / size)), 1)
        # Walls are seen over less than half a turn.
        cell = (place + 1) * side // 2 * 4 * side + angle * side // 1
        _, cell = np.unique(cell, return_inverse=True)
        counts, sums = np.bincount(cell), np.bincount(cell, rest)
        full = counts >= size / 4
        if np.count_nonzero(full) < FEWEST_CELLS:
            break
        shared = np.mean(sums[full] ** 2 / counts[full]) / np.mean(rest**2)
        most = max(most, float(shared))
    return most
