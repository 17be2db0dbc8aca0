"""What an image says for and against a wall: the wall rendered, and compared.

Each pixel inside of the wall's outline shows the wall, something in front of it, which
may stand there, or something behind it, which may not: where the wall should be there
is free space. Along the axis the wall reaches from where the image begins to explain it
to where it is refuted.
"""

__all__ = [
    "LIMIT",
    "Candidate",
    "Evidence",
    "Scene",
    "meeting",
    "ring",
    "shown",
    "turned",
    "weighed",
]

import dataclasses
import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.find.normals import Normals
from impostor_jax.find.view import Box, View
from impostor_jax.fit.surface import spread
from impostor_jax.geometry.so3 import directions_across

LIMIT = 3.5
"""Deviations within which a reading is explained."""

AGREEING = 0.6
"""Cosine between a wall's normal and the measured one, at least."""

UNSURE = 0.25
"""Deviation from which a measured normal says nothing, in radians."""

MOST_SEEN = 20_000
"""Pixels of a box that are looked at; of a larger one every n-th row and column."""

MOST_WEIGHED = 3_000
"""Pixels inside of an outline that are weighed, evenly spread."""

MOST_POOLED = 2048
"""Readings that tell where along its axis a wall may be."""

LEAST_COSINE = 0.05
"""Cosine of the incidence, at least, of a reading that lies on a wall."""

INNER = 0.7
"""Pixels inside of an outline, from which a pixel shows what is there."""

NARROW = 12.0
"""Pixels across a narrow wall."""

MOST_BINS = 128
"""Bins along an axis."""

ARC_BINS = 72
"""Bins of the angle around an axis."""


CIRCLE = np.stack([fn(np.arange(16) * np.pi / 8) for fn in (np.cos, np.sin)], axis=1)
"""Points of a circle."""


class Candidate(NamedTuple):
    """A wall that may be there.

    Attributes:
        center: A point of its axis, in the camera's frame, in meters.
        axis: Unit vector.
        radius: In meters.
        side: 1 where it is seen from outside, and -1 from inside.
        limits: Along the axis from the center, between which it may be.
    """

    center: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    radius: float
    side: float
    limits: tuple[float, float] = (-np.inf, np.inf)


class Pool(NamedTuple):
    """Readings that are free, or some of them, evenly spread.

    Attributes:
        points: In meters.
        views: Unit directions in which they are seen.
        depth: In meters.
        sigma: Of it, face on.
        most: Distance from a surface that is explained, at any incidence.
    """

    points: Float[np.ndarray, "p 3"]
    views: Float[np.ndarray, "p 3"]
    depth: Float[np.ndarray, " p"]
    sigma: Float[np.ndarray, " p"]
    most: Float[np.ndarray, " p"]


@dataclasses.dataclass(frozen=True)
class Scene:
    """What candidates are compared with.

    Attributes:
        view: What is searched.
        normals: Of it.
        noise: Factor of its sigma, from planes.
        usable: Readings that are no flying pixels.
        free: Those that nothing has explained yet.
        planes: Those that lie on a plane.
        shared: Pixels that share an error, from planes.
    """

    view: View
    normals: Normals
    noise: float
    usable: Bool[np.ndarray, "h w"]
    free: Bool[np.ndarray, "h w"]
    planes: Bool[np.ndarray, "h w"]
    shared: float = 1.0

    @functools.cached_property
    def pool(self) -> Pool:
        """Of the readings that are free."""
        view, index = self.view, np.flatnonzero(self.free)
        if len(index):
            index = index[spread(len(index), MOST_POOLED)]
        depth, sigma = view.depth.ravel()[index], self.noise * view.sigma.ravel()[index]
        cosines = np.linspace(LEAST_COSINE, 1, 20)
        away = [cosine * view.deviation(depth, sigma, cosine) for cosine in cosines]
        return Pool(
            view.points.reshape(-1, 3)[index],
            view.views.reshape(-1, 3)[index],
            depth,
            sigma,
            1.1 * LIMIT * np.max(away, axis=0),
        )


@dataclasses.dataclass(frozen=True)
class Evidence:
    """How a wall is seen; counts are in pixels of the view.

    Attributes:
        wall: The candidate.
        ends: Along its axis from its center, in meters.
        pixels: Flat indices of those that it explains, of those weighed.
        explained: How many it explains.
        behind: Where something behind it is seen.
        other: Of another surface: taken, of a plane, or of other normals.
        arc: Around the axis, over which it is explained, in radians.
        misfit: Mean square of the deviations of what it explains.
        width: Of a pixel there, in meters.
        share: How many pixels each of those stands for.
    """

    wall: Candidate
    ends: tuple[float, float]
    pixels: Int[np.ndarray, " n"]
    explained: float
    behind: float
    other: float
    arc: float
    misfit: float
    width: float = 0.0
    share: float = 1.0

    @property
    def is_narrow(self) -> bool:
        """Whether it is so few pixels wide that what is proposed for it is rough."""
        return 2 * self.wall.radius < NARROW * self.width


class Meeting(NamedTuple):
    """Where rays meet a wall; of any shape, and zero where they miss it.

    Attributes:
        hit: Whether they do, in front of the camera.
        depth: In meters.
        along: Place along the axis, in meters.
        cosine: Of the incidence.
        inside: How far inside of the outline, in pixels.
    """

    hit: Bool[np.ndarray, "..."]
    depth: Float[np.ndarray, "..."]
    along: Float[np.ndarray, "..."]
    cosine: Float[np.ndarray, "..."]
    inside: Float[np.ndarray, "..."]


def meeting(
    view: View,
    x: Float[np.ndarray, "..."],
    y: Float[np.ndarray, "..."],
    wall: Candidate,
) -> Meeting:
    """Where rays at some places of a view meet a wall.

    Args:
        view: What is searched.
        x: Of the rays, as the view has them.
        y: Likewise.
        wall: The candidate, in the camera's frame; it has no ends here.
    """
    c, a, r, side, _ = wall
    c, a = c.astype(np.float32).tolist(), a.astype(np.float32).tolist()
    if view.is_central:
        # Rays d = (x, y, 1) from the origin; off is the center.
        da = a[0] * x + a[1] * y + a[2]
        d = (x - da * a[0], y - da * a[1], 1 - da * a[2])
        off = (c[0], c[1], c[2])
        length = np.sqrt(1 + x * x + y * y)
    else:
        da = a[2]
        d = (-da * a[0], -da * a[1], 1 - da * a[2])
        off = (c[0] - x, c[1] - y, c[2])
        length = 1.0
    oa = off[0] * a[0] + off[1] * a[1] + off[2] * a[2]
    w = tuple(off[k] - oa * a[k] for k in range(3))
    square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    # As a cross product, which does not cancel.
    across = (
        (d[1] * w[2] - d[2] * w[1]) ** 2
        + (d[2] * w[0] - d[0] * w[2]) ** 2
        + (d[0] * w[1] - d[1] * w[0]) ** 2
    )
    gap = square * (r * r) - across
    hit = (gap > 0) & (square > 1e-8)
    root = np.sqrt(np.where(hit, gap, 0))
    square = np.where(square > 1e-8, square, 1)
    depth = (d[0] * w[0] + d[1] * w[1] + d[2] * w[2] - side * root) / square
    hit &= depth > 0
    depth = np.where(hit, depth, 0)
    chord = np.minimum(root / (np.sqrt(square) * r), 1)
    width = view.width(np.where(hit, depth, 1))
    inside = r * (1 - np.sqrt(1 - chord * chord)) / width
    return Meeting(hit, depth, depth * da - oa, root / (r * length), inside)


def _out(
    view: View,
    x: Float[np.ndarray, " n"],
    y: Float[np.ndarray, " n"],
    wall: Candidate,
    depth: Float[np.ndarray, " n"],
    along: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "n 3"]:
    """Unit directions away from the axis, where rays meet a wall."""
    off = view.lifted(x, y, depth) - wall.center
    return (off - along[:, None] * wall.axis) / wall.radius


def ring(
    wall: Candidate, ends: tuple[float, float], scale: float = 1.0
) -> Float[np.ndarray, "n 3"]:
    """Points around a wall, from end to end."""
    around = scale * wall.radius * (CIRCLE @ directions_across(wall.axis))
    place = np.linspace(*ends, 8)[:, None, None]
    return (wall.center + place * wall.axis + around).reshape(-1, 3)


def weighed(scene: Scene, wall: Candidate) -> Evidence | None:
    """What there is for and against a wall; None where nothing is for it."""
    view = scene.view
    reach = _reach(scene, wall)
    if reach is None:
        return None
    box = view.box_around(ring(wall, reach, 1.05))
    if box is None:
        return None
    index, step = _inside(view, wall, reach, box)
    if len(index) < 4:
        return None
    x, y = view.x.ravel()[index], view.y.ravel()[index]
    met = meeting(view, x, y, wall)
    z, seen = view.depth.ravel()[index], scene.usable.ravel()[index]
    sigma = scene.noise * view.sigma.ravel()[index]
    # Without a reading it is 0, and what comes of it is not looked at.
    scale = np.where(seen, view.deviation(met.depth, sigma, met.cosine), 1)
    deviation = (z - met.depth) / scale
    out = _out(view, x, y, wall, met.depth, met.along)
    normal = scene.normals.normal.reshape(-1, 3)[index]
    agrees = wall.side * (normal * out).sum(axis=-1) > AGREEING
    agrees |= scene.normals.error.ravel()[index] > UNSURE
    core = met.inside > INNER
    near = seen & (np.abs(deviation) < LIMIT)
    explained = near & scene.free.ravel()[index] & agrees
    behind = core & seen & (deviation > LIMIT)
    other = core & near & ~explained
    width = step * view.width(float(np.median(met.depth)))
    kept = (explained & core, behind, other, core)
    ends = _ends(met.along, reach, width, kept)
    if ends is None:
        return None
    between = (met.along >= ends[0]) & (met.along <= ends[1])
    explained &= between
    core &= between
    told = explained & core
    if np.count_nonzero(told) < 4:
        return None

    def number(mask: Bool[np.ndarray, " n"]) -> float:
        return float(np.count_nonzero(mask & between)) * step

    return Evidence(
        wall=wall,
        ends=ends,
        pixels=index[explained],
        explained=number(explained),
        behind=number(behind),
        other=number(other),
        arc=_arc(out, wall.axis, told, core),
        misfit=float(np.mean(deviation[told] ** 2)),
        width=width / step,
        share=step,
    )


def _reach(scene: Scene, wall: Candidate) -> tuple[float, float] | None:
    """Ends between which readings lie on a wall, with a radius more at each."""
    view, pool = scene.view, scene.pool
    off = pool.points - wall.center
    along = off @ wall.axis
    distance = np.sqrt(np.maximum((off**2).sum(axis=1) - along**2, 0))
    low, high = wall.limits
    near = np.abs(distance - wall.radius) < pool.most
    index = np.flatnonzero(near & (along > low) & (along < high))
    along, distance = along[index], distance[index]
    across = off[index] - along[:, None] * wall.axis
    cosine = -(across * pool.views[index]).sum(axis=1) / np.maximum(distance, 1e-9)
    deviation = view.deviation(pool.depth[index], pool.sigma[index], cosine)
    deviation *= np.maximum(np.abs(cosine), LEAST_COSINE)
    near = np.abs(distance - wall.radius) < LIMIT * deviation
    near &= wall.side * cosine > 0
    if np.count_nonzero(near) < 4:
        return None
    places = along[near]
    return (
        max(float(places.min()) - wall.radius, low),
        min(float(places.max()) + wall.radius, high),
    )


def _inside(
    view: View, wall: Candidate, reach: tuple[float, float], box: Box
) -> tuple[Int[np.ndarray, " n"], float]:
    """Pixels inside of an outline, of large ones some; and how many each stands for."""
    rows, cols = box
    size = (rows.stop - rows.start) * (cols.stop - cols.start)
    step = max(1, int(np.ceil(np.sqrt(size / MOST_SEEN))))
    row = np.arange(rows.start, rows.stop, step)
    col = np.arange(cols.start, cols.stop, step)
    pick = np.s_[rows.start : rows.stop : step, cols.start : cols.stop : step]
    met = meeting(view, view.x[pick], view.y[pick], wall)
    hit = met.hit & (met.along > reach[0]) & (met.along < reach[1])
    down, right = np.nonzero(hit)
    index = row[down] * view.depth.shape[1] + col[right]
    share = float(step * step)
    if len(index) > MOST_WEIGHED:
        share *= len(index) / MOST_WEIGHED
        index = index[spread(len(index), MOST_WEIGHED)]
    return index, share


def _ends(
    along: Float[np.ndarray, " n"],
    reach: tuple[float, float],
    width: float,
    kept: tuple[Bool[np.ndarray, " n"], ...],
) -> tuple[float, float] | None:
    """Ends of a wall: from its fullest part to where the image refutes it.

    What is hidden, or has no reading, neither supports nor refutes it, so that a wall
    goes on behind what stands in front.
    """
    low, high = reach
    bins = int(np.clip((high - low) / (2 * width), 8, MOST_BINS))
    place = np.clip(((along - low) / (high - low) * bins).astype(int), 0, bins - 1)
    # A bin or two tell little.
    explained, behind, other, core = (
        np.convolve(np.bincount(place[mask], minlength=bins), np.ones(3), "same")
        for mask in kept
    )
    if explained.max() < 3:
        return None
    typical = np.median(explained[explained >= 0.25 * explained.max()])
    against = behind + other
    # Of a wall that is looked along, far bins have few pixels, but those are full.
    enough = (explained >= 0.25 * typical) | (explained >= np.maximum(0.7 * core, 6))
    supports = enough & (explained > against)
    refutes = (against > explained) & (against >= 0.25 * core) & (core > 0)
    middle = int(np.argmax(np.convolve(explained, np.ones(5), "same")))
    first = last = middle
    for k in range(middle, -1, -1):
        if refutes[k]:
            break
        first = k if supports[k] else first
    for k in range(middle, bins):
        if refutes[k]:
            break
        last = k if supports[k] else last
    size = (high - low) / bins
    start, stop = low + first * size, low + (last + 1) * size
    mine = kept[0] & (along >= start) & (along <= stop)
    if np.count_nonzero(mine) < 4:
        return None
    # A few may be strays.
    places = np.sort(along[mine])
    few = min(2, len(places) // 4)
    outer = float(places[few]), float(places[-1 - few])
    return max(start, outer[0] - width), min(stop, outer[1] + width)


def _arc(
    out: Float[np.ndarray, "n 3"],
    axis: Float[np.ndarray, "3"],
    told: Bool[np.ndarray, " n"],
    core: Bool[np.ndarray, " n"],
) -> float:
    """Angle around the axis over which a wall is explained, in radians."""
    turn = turned(out, axis, ARC_BINS)
    found = np.bincount(turn[told], minlength=ARC_BINS)
    there = np.bincount(turn[core], minlength=ARC_BINS)
    return (
        2 * np.pi / ARC_BINS * np.count_nonzero((found >= 2) & (found >= 0.3 * there))
    )


def turned(
    vectors: Float[np.ndarray, "*b 3"], axis: Float[np.ndarray, "3"], bins: int
) -> Int[np.ndarray, "*b"]:
    """Number of the bin that the angle of each vector around an axis is in."""
    first, second = directions_across(axis)
    turn = (np.arctan2(vectors @ second, vectors @ first) / (2 * np.pi) + 0.5) * bins
    return turn.astype(int) % bins


def shown(
    scene: Scene, evidence: Evidence, own: Bool[np.ndarray, "h w"], mixed: bool
) -> Bool[np.ndarray, "h w"]:
    """Pixels that show a wall: inside of its outline, with nothing in front.

    The outline of a thin wall is known to a pixel or two, by which the mask may be too
    small: readings beside it that are as far are its own, too.

    Args:
        scene: What is searched.
        evidence: Of the wall.
        own: Readings that may be its own.
        mixed: Whether readings beside the outline may be of what is behind it: a fit
            knows, and leaves out those beside the mask's edge, which so must be there.
    """
    view, wall, ends = scene.view, evidence.wall, evidence.ends
    region = np.zeros(view.depth.shape, bool)
    box = view.box_around(ring(wall, ends, 1.2 if mixed else 1.05))
    if box is None:
        return region
    met = meeting(view, view.x[box], view.y[box], wall)
    # Ends are known to a pixel; beyond them nothing is near the wall.
    middle = wall.center + (ends[0] + ends[1]) / 2 * wall.axis
    width = float(view.width(max(middle[2], 0.0)))
    hit = met.hit & (met.along > ends[0] - width) & (met.along < ends[1] + width)
    row, col = np.nonzero(hit)
    depth, cosine = met.depth[hit], met.cosine[hit]
    z = view.depth[box][hit]
    deviation = view.deviation(depth, scene.noise * view.sigma[box][hit], cosine)
    near = own[box][hit] & (np.abs(z - depth) < (LIMIT + 0.5) * deviation)
    if mixed:
        near |= ((z > depth) & (met.inside[hit] < 1.5)) | (z == 0)
        beside = _beside(scene, wall, ends, box, own, width)
        region[box] |= beside & ~met.hit
    else:
        x, y = view.x[box][hit], view.y[box][hit]
        out = _out(view, x, y, wall, depth, met.along[hit])
        normal, error = scene.normals.normal[box][hit], scene.normals.error[box][hit]
        agrees = wall.side * (normal * out).sum(axis=-1) > AGREEING
        near &= agrees | (error > UNSURE)
    region[box[0].start + row[near], box[1].start + col[near]] = True
    return region


def _beside(
    scene: Scene,
    wall: Candidate,
    ends: tuple[float, float],
    box: Box,
    own: Bool[np.ndarray, "h w"],
    width: float,
) -> Bool[np.ndarray, "r c"]:
    """Pixels of a box up to 1.5 widths outside of an outline that are as far."""
    view = scene.view
    wider = wall._replace(radius=wall.radius + 1.5 * width)
    met = meeting(view, view.x[box], view.y[box], wider)
    near = met.hit & (met.along > ends[0]) & (met.along < ends[1])
    reach = wall.radius + LIMIT * scene.noise * view.sigma[box]
    return near & own[box] & (np.abs(view.depth[box] - met.depth) < reach)
