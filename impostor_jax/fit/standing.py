"""Ends that stand on something: where the surface of it meets the wall all around.

Depth tells an end by what is seen behind it. A can that stands on a table has no such
end: the table goes on from its foot, and hides what may be below. But where a plane
across the axis meets the wall all along the foot that is seen, and goes around it, the
object ends there. A box that touches a can meets it along a line, and stands in front
of the wall elsewhere; one that hides the can's foot lies to one side of it.

So readings of that plane which a wall that goes on would hide are taken for background
far behind, and the region for what of the wall is above the plane: a fit of these finds
the end where all others are found, at the region's edge.
"""

__all__ = ["standing_on"]

import math
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.camera.ray_table import shows_image
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.floor import fullest_stretch
from impostor_jax.fit.gather import passed_by
from impostor_jax.fit.per_pixel import law_of
from impostor_jax.fit.problem import RayList
from impostor_jax.fit.regions import SQUARE
from impostor_jax.fit.seam import solved
from impostor_jax.fit.seen import Seen
from impostor_jax.fit.surface import cropped
from impostor_jax.fit.touching import going_on
from impostor_jax.geometry.so3 import directions_across
from impostor_jax.numerics import product
from impostor_jax.opencv import cv2
from impostor_jax.primitives.base import in_camera_frame
from impostor_jax.sensor.base import AbstractDepthNoise

OFF = 4.0
"""Standard deviations up to which a reading is of the wall, or of the plane."""

FEWEST = 30
"""Readings of the wall, of a plane, and of a plane in front of a wall that would go on,
at least."""

LOWEST = 0.95
"""Part of the wall's readings that lie above the place where its end is looked for."""

BAND = 0.5
"""Radii above and below it within which it is looked for, and along which all that is
read must be the wall's or the plane's."""

MARGIN = 8
"""Pixels around a region that are looked at, besides half of its longer side."""

THICKNESS, WITHIN = 6.0, 3.0
"""Standard deviations along the axis within which readings of a plane lie of its first
estimate, and of the next: beside the edge of what stands below lies that's side."""

LEAST_SLANT = 0.1
"""Of a reading's deviation, what it may be off along the axis, at least."""

WIDE = 4.0
"""Sizes from the axis up to which readings are of the plane."""

USUAL_TILT, MOST_TILT = 0.01, 0.03
"""Slopes of a plane against one across the axis: what things stand on, and things, are
level to half a degree; what slopes by two degrees is something else."""

FACING = 0.2
"""Cosine of the incidence from which on a wall's readings are no other surface's."""

MOST_BEHIND = 0.05
"""Part of the readings of a band that may lie behind wall and plane: where the wall is
seen below the plane that does not meet it."""

LEAST_EXPLAINED = 0.25
"""Part of those that tell plane from wall that must be of the plane; the others lie in
front of both, and tell nothing."""

BEYOND = 1.25
"""Radii from the axis from which on readings show that the plane goes on: a can that
stands on another one stands on a crescent."""

SECTORS, LEAST_SECTORS = 12, 7
"""Sectors around the axis, and those in which the plane is seen at least: on more than
one side of the object."""

IN_SECTOR, MOST_LOWER = 6, 0.2
"""Readings of the plane in a sector, at least, and part of all beside the wall that may
lie behind it: boxes beside a box, and a ring around a can, end before a table."""

TELLING, POOL = 20, 200
"""Readings of a sector, the nearest to the axis, that tell where the plane is, for
farther off is the edge of what stands below; and those that they are chosen from."""

MANY = 40_000
"""Rays of which a plane is estimated by fewer, evenly spread."""

STRIP = 2.0
"""Pixels of the wall above its foot that tell whether it comes down to the plane."""

MOST_GAP, BY_CHANCE = 0.3, 4.0
"""Deviations by which their mean may lie behind the wall, and those of the mean."""

LEAST_SHOWN = 0.1
"""Sine of the angle to the line of sight from which on an image shows a length."""

ROUNDS = 3
"""In which a plane is estimated."""

UNSURE = 2
"""Pixels of a wall beside its foot whose readings may be of the plane."""

LEVEL = np.zeros(2)
"""Slope of a plane that is across the axis."""


def standing_on(
    seen: Seen, body: AbstractBody, ends_seen: Bool[np.ndarray, " e"]
) -> Seen:
    """An object with background behind the ends that it stands on; itself without any.

    Args:
        seen: An object.
        body: What was fitted to it, in the world frame.
        ends_seen: Which of its ends are seen.
    """
    if not shows_image(seen.camera):
        return seen
    height, width = (one.stop - one.start for one in cropped(seen.region))
    asked = np.zeros_like(seen.region)
    asked[cropped(seen.region, margin=max(height, width) // 2 + MARGIN)] = True
    row, col, rays = seen._replace(region=asked).rays()
    exists = rays.exists
    row, col = row[exists], col[exists]
    inside = np.zeros(len(exists), bool)
    inside[exists] = seen.region[row, col]
    placed = in_camera_frame(body, seen.camera)
    around = _looked_at(rays, inside, placed, ends_seen, law_of(seen.noise))
    stride = math.isqrt(len(row) // MANY) + 1
    some = around
    if stride > 1:
        is_some = (row % stride == 0) & (col % stride == 0)
        some = around.at(np.flatnonzero(exists)[is_some])
    spacing, ends = float(seen.camera.spacing), np.flatnonzero(~ends_seen).tolist()
    found = [foot for end in ends if (foot := _foot_at(around, some, end, spacing))]
    if not found:
        return seen
    image, region, unsure = seen.image.copy(), seen.region, seen.unsure
    feet = np.full(region.shape, -1.0) if seen.feet is None else seen.feet.copy()
    for foot in found:
        below, shown, own = np.zeros((3, *region.shape), bool)
        for marks, which in zip((below, shown, own), foot[:3], strict=True):
            marks[row, col] = which[exists]
        region = region & ~below | own
        near = cv2.dilate(below.astype(np.uint8), SQUARE, iterations=UNSURE) > 0
        unsure = region & (near if unsure is None else near | unsure)
        image[shown] = 2 * image[shown].max()
        feet[shown] = foot.doubt
    return seen._replace(image=image, region=region, unsure=unsure, feet=feet)


class _Around(NamedTuple):
    """What is read around a body, and where its wall would be met if it went on.

    Attributes:
        radius: Of the body.
        size: Of the body.
        axes: Unit vectors outward across its ends.
        start: Of the rays, from the body's center.
        direction: Of the rays, with z = 1.
        depth: That was read.
        read: Where that is.
        inside: Which pixels are of the object's region.
        wall: Which rays would meet the wall.
        surface: How deep.
        place: How far towards each end from the center.
        cosine: Of the incidence there.
        sigma: Standard deviation of a reading.
    """

    radius: float
    size: float
    axes: Float[np.ndarray, "e 3"]
    start: Float[np.ndarray, "n 3"]
    direction: Float[np.ndarray, "n 3"]
    depth: Float[np.ndarray, " n"]
    read: Bool[np.ndarray, " n"]
    inside: Bool[np.ndarray, " n"]
    wall: Bool[np.ndarray, " n"]
    surface: Float[np.ndarray, " n"]
    place: Float[np.ndarray, "e n"]
    cosine: Float[np.ndarray, " n"]
    sigma: Float[np.ndarray, " n"]

    def at(self, rays: Int[np.ndarray, " m"]) -> "_Around":
        """Of some rays."""
        whole = {name: getattr(self, name) for name in ("radius", "size", "axes")}
        parts = {name: x for name, x in self._asdict().items() if name not in whole}
        place = parts.pop("place")[:, rays]
        chosen = {name: x[rays] for name, x in parts.items()}
        return _Around(**whole, **chosen, place=place)


def _looked_at(
    rays: RayList,
    inside: Bool[np.ndarray, " n"],
    body: AbstractBody,
    ends_seen: Bool[np.ndarray, " e"],
    noise: AbstractDepthNoise,
) -> _Around:
    """What is read along some rays, of which those `inside` are of a body's region."""
    told = _beyond_ends(rays, body, ends_seen, noise)
    size, axes, surface, place, is_met, cosine, sigma = map(np.asarray, told)
    direction = rays.directions()
    start = np.broadcast_to(-np.asarray(body.center, float), direction.shape)
    if rays.start is not None:
        start = start + rays.start
    return _Around(
        radius=float(body.radius),
        size=float(size),
        axes=axes.astype(float),
        start=start,
        direction=direction,
        depth=np.asarray(rays.depth, float),
        read=np.asarray(rays.exists & (rays.depth > 0)),
        inside=inside,
        wall=is_met & np.isfinite(surface),
        surface=surface.astype(float),
        place=place.astype(float),
        cosine=cosine,
        sigma=np.where(sigma > 0, sigma, np.inf).astype(float),
    )


class _Level(NamedTuple):
    """Where a plane is that is about across an axis.

    Attributes:
        axis: Unit vector.
        across: Two unit vectors across it.
        level: Where the axis meets the plane, from the body's center.
        slope: Of the plane along these two.
        deviation: Of the level.
    """

    axis: Float[np.ndarray, "3"]
    across: Float[np.ndarray, "2 3"]
    level: float
    slope: Float[np.ndarray, "2"] = LEVEL
    deviation: float = np.inf


class _Plane(NamedTuple):
    """How rays meet a plane.

    Attributes:
        depth: Of the plane along the rays; `inf` where they do not meet it.
        beside: Where they do, across the axis.
    """

    depth: Float[np.ndarray, " n"]
    beside: Float[np.ndarray, "n 2"]


class _Foot(NamedTuple):
    """What is seen of a body that stands on something.

    Attributes:
        below: Which rays would meet its wall below the plane.
        shown: Which of them read the plane.
        own: Which read the wall just above it.
        doubt: By how many pixels the end may be off, either way.
    """

    below: Bool[np.ndarray, " n"]
    shown: Bool[np.ndarray, " n"]
    own: Bool[np.ndarray, " n"]
    doubt: float


def _foot_at(around: _Around, some: _Around, end: int, spacing: float) -> _Foot | None:
    """What is seen where a body stands on an end; None where it stands on nothing.

    Args:
        around: What is read around it.
        some: The same of readings enough to tell a plane.
        end: Number of one that is not seen.
        spacing: Distance of neighboring rays over the depth.
    """
    level = _level_at(some, end)
    if level is None:
        return None
    plane = _plane(around, level)
    count = np.count_nonzero
    below = around.wall & (plane.depth < around.surface)
    first = np.minimum(plane.depth, around.surface)
    off = np.where(around.read, around.depth - first, 0) / around.sigma
    is_either, is_behind = np.abs(off) < OFF, off > OFF
    band = around.wall & around.read & (around.cosine > FACING)
    band &= np.abs(around.place[end] - level.level) < BAND * around.radius
    tells = band & below & (around.surface - plane.depth > OFF * around.sigma)
    is_met = count(tells & is_either) >= max(FEWEST, LEAST_EXPLAINED * count(tells))
    if not is_met or count(band & is_behind) > MOST_BEHIND * count(band):
        return None
    on_plane = around.read & (below | ~around.wall)
    on_plane &= np.abs(around.depth - plane.depth) < OFF * around.sigma
    if not _goes_around(around, plane, below, on_plane):
        return None
    # A pixel's length along the axis, as the image shows it there.
    view = around.direction[tells]
    cosine = view @ around.axes[end] / np.linalg.norm(view, axis=1)
    shown = np.sqrt(np.maximum(1 - cosine**2, LEAST_SHOWN**2))
    pixel = float(np.median(spacing * around.depth[tells] / shown))
    above = level.level - around.place[end]
    if _hovers(off[band & ~below & (above < STRIP * pixel) & (off > -OFF)]):
        return None
    return _Foot(
        below=below,
        shown=below & on_plane,
        own=band & ~below & is_either,
        # With this deviation, if all within are as likely.
        doubt=3**0.5 * level.deviation / pixel,
    )


def _hovers(off: Float[np.ndarray, " n"]) -> bool:
    """Whether readings just above a plane lie behind a wall that comes down to it.

    Args:
        off: How far behind it they lie, in deviations.
    """
    if not len(off):
        return True
    most = MOST_GAP + BY_CHANCE / np.sqrt(len(off))
    return bool(np.minimum(off, OFF).mean() > most)


def _goes_around(
    around: _Around,
    plane: _Plane,
    below: Bool[np.ndarray, " n"],
    on_plane: Bool[np.ndarray, " n"],
) -> bool:
    """Whether a plane is seen beside a wall in most directions, from the axis.

    Args:
        around: What is read.
        plane: The plane.
        below: Which rays would meet the wall below it.
        on_plane: Which of the readings are of it.
    """
    away = np.hypot(*plane.beside.T)
    # What stands in front tells nothing.
    tells = around.read & (below | ~around.wall) & (away > BEYOND * around.radius)
    tells &= (away < WIDE * around.size) & np.isfinite(plane.depth)
    tells &= around.depth - plane.depth > -OFF * around.sigma
    sectors = _by_sector(plane.beside, tells)
    counts = np.array([(len(one), np.count_nonzero(on_plane[one])) for one in sectors])
    total, shown = counts.T
    is_plane = (shown >= IN_SECTOR) & (total - shown <= MOST_LOWER * total)
    return bool(np.count_nonzero(is_plane) >= LEAST_SECTORS)


def _by_sector(
    beside: Float[np.ndarray, "n 2"], which: Bool[np.ndarray, " n"]
) -> list[Int[np.ndarray, "..."]]:
    """Numbers of some places in each sector around an axis, the nearest to it first."""
    order = np.flatnonzero(which)
    order = order[np.argsort(np.hypot(*beside[order].T))]
    turn = np.arctan2(*beside[order].T) / (2 * np.pi) + 0.5
    sector = (turn * SECTORS).astype(int) % SECTORS
    return [order[sector == k] for k in range(SECTORS)]


def _level_at(around: _Around, end: int) -> _Level | None:
    """The plane across the axis that lies before a wall at an end, if it went on."""
    axis, sigma = around.axes[end], around.sigma
    across = directions_across(axis)
    points = around.start + around.direction * around.depth[:, None]
    along, beside = points @ axis, points @ across.T
    place = around.place[end]
    # Caps have no place along the axis.
    on_wall = around.wall & around.read & around.inside & np.isfinite(place)
    on_wall &= np.abs(around.depth - around.surface) < OFF * sigma
    if np.count_nonzero(on_wall) < FEWEST:
        return None
    lowest = np.quantile(place[on_wall], LOWEST)
    in_front = around.wall & around.read
    in_front &= np.abs(along - lowest) < BAND * around.radius
    in_front &= around.surface - around.depth > OFF * sigma
    if np.count_nonzero(in_front) < FEWEST:
        return None
    slant = sigma * np.maximum(np.abs(around.direction @ axis), LEAST_SLANT)
    thick = THICKNESS * float(np.median(slant[in_front]))
    level = float(np.median(fullest_stretch(along[in_front], thick)))
    plane = _plane(around, _Level(axis, across, level))
    is_low = np.abs(along - level) < thick + MOST_TILT * np.hypot(*beside.T)
    # Those alone that may be nearest to the axis.
    sectors = _by_sector(plane.beside, _tells_plane(around, plane) & is_low)
    some = np.concatenate([one[:POOL] for one in sectors])
    pool, along, beside, slant = around.at(some), along[some], beside[some], slant[some]
    slope, deviation, reach = LEVEL, np.inf, np.inf
    for _ in range(ROUNDS):
        plane = _plane(pool, _Level(axis, across, level, slope))
        is_low = np.abs(along - level - beside @ slope) < reach
        sectors = _by_sector(plane.beside, _tells_plane(pool, plane) & is_low)
        sectors = [one[:TELLING] for one in sectors]
        near = np.concatenate(sectors)
        if len(near) < FEWEST:
            return None
        terms = np.column_stack([np.ones(len(near)), USUAL_TILT * beside[near]])
        found = solved(terms, along[near] - level, slant[near])
        level += float(found.value[0])
        slope = USUAL_TILT * found.value[1:]
        # What is uneven, or slopes, is met somewhere below its wall.
        parts = found.deviation[0], _unevenness(sectors, found.rest, slant[near])
        deviation = float(np.linalg.norm([*parts, *slope * around.radius]))
        reach = thick * (WITHIN / THICKNESS)
    if np.linalg.norm(slope) > MOST_TILT:
        return None
    return _Level(axis, across, level, slope, deviation)


def _tells_plane(around: _Around, plane: _Plane) -> Bool[np.ndarray, " n"]:
    """Which readings may be of a plane, or just above or below it.

    By where their rays lead, and not by what they read, which noise decides.
    """
    tells = around.read & (np.hypot(*plane.beside.T) < WIDE * around.size)
    apart = around.surface - plane.depth > OFF * around.sigma
    return tells & (~around.wall | apart)


def _unevenness(
    sectors: list[Int[np.ndarray, "..."]],
    rest: Float[np.ndarray, " n"],
    deviation: Float[np.ndarray, " n"],
) -> float:
    """Deviation from a plane of its sectors' means, over what noise lets them scatter.

    Args:
        sectors: Numbers of readings.
        rest: What the plane leaves of these, one after the other, in deviations.
        deviation: Of each.
    """
    ends = np.cumsum([len(one) for one in sectors])[:-1]
    off = np.split(rest * deviation, ends)
    full = [one for one in off if len(one) >= IN_SECTOR]
    if not full:
        return 0.0
    by_noise = np.array([one.var() / len(one) for one in full])
    squares = np.array([one.mean() ** 2 for one in full])
    # And by their own scatter.
    by_chance = (1 + np.sqrt(2 / len(full))) * by_noise.mean()
    return float(np.sqrt(max(squares.mean() - by_chance, 0.0)))


def _plane(around: _Around, level: _Level) -> _Plane:
    """A plane about across an axis, along all rays."""
    normal = level.axis - level.slope @ level.across
    towards = around.direction @ normal
    depth = level.level - around.start @ normal
    depth /= np.where(towards == 0, 1, towards)
    is_met = (towards != 0) & (depth > 0)
    places = around.start + around.direction * np.where(is_met, depth, 0)[:, None]
    return _Plane(np.where(is_met, depth, np.inf), places @ level.across.T)


@jax.jit
def _beyond_ends(
    rays: RayList,
    body: AbstractBody,
    ends_seen: Bool[Array, " e"],
    noise: AbstractDepthNoise,
) -> tuple[Array, ...]:
    """How rays meet a body that goes on beyond the ends that are not seen.

    Its size, and unit vectors outward across its ends; the surface's depth, how far
    towards each end from the body's center it is, whether it is met, under which
    cosine, and a reading's standard deviation there.
    """
    longer = going_on(body, ends_seen)
    _, seen, _, sigma = passed_by(rays, longer, noise)
    axes = body.end_axes
    moved = product(axes, longer.center - body.center)
    place = longer.outward(seen) + moved[:, None]
    met = seen.depth, place, ~seen.is_missed, seen.cos_incidence, sigma
    return body.size, axes, *met
