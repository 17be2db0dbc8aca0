"""How far apart two solids are, and where one that slides comes to touch another.

Two convex solids are as far apart as the widest gap between two parallel planes that
separate them, and such planes are what is found: a distance is never more than it is,
but for rounding.
"""

__all__ = ["are_apart", "slide_to_touch"]

import itertools

import numpy as np
from jaxtyping import Float

from data_synth.solid import Point, Solid

ACCURACY = 1e-7
"""Of a distance, in meters."""

MOST_STEPS = 100
"""In the search for a distance, which takes about ten."""


def are_apart(one: Solid, other: Solid, gap: float) -> bool:
    """Whether two solids are surely apart by more than a gap, in meters."""
    between = np.linalg.norm(one.middle - other.middle)
    if between > one.reach + other.reach + gap:
        return True
    return _separation(one, other, gap)[0] > gap


def slide_to_touch(one: Solid, other: Solid, along: Point, gap: float) -> float:
    """How far a solid has to be moved for a gap to another.

    From beyond the distance grows ever faster with the move, so Newton's steps come
    nearer and never too near.

    Args:
        one: It moves.
        other: It stays.
        along: Unit vector along which it moves.
        gap: In meters, positive.

    Returns:
        In meters, from 0; 0 where that leaves a larger gap.
    """
    length = float(np.linalg.norm(one.middle - other.middle))
    length += one.reach + other.reach + gap
    while length > 0:
        distance, normal = _separation(one.moved(length * along), other)
        if distance < gap + ACCURACY:
            return length
        opens = normal @ along
        # Where the plane would never close they do not meet at all.
        length -= float((distance - gap) / opens) if opens > 0 else np.inf
    return 0.0


def _separation(
    one: Solid, other: Solid, enough: float = np.inf
) -> tuple[float, Point]:
    """Distance from the other to the one, 0 if they overlap, and its unit vector.

    Once it is known to be more than enough it is not looked for any further.

    References:
        Gilbert, Johnson, Keerthi (1988), "A fast procedure for computing the distance
        between complex objects in three-dimensional space".
    """

    def least_along(direction: Point) -> Point:
        """Of all differences of two points the one that is least in a direction."""
        return one.farthest(-direction) - other.farthest(direction)

    # Any direction will do, also where the middles are the same.
    nearest = least_along(one.middle - other.middle + ACCURACY)
    corners, best, normal = nearest[None], 0.0, nearest
    for _ in range(MOST_STEPS):
        length = float(np.linalg.norm(nearest))
        if length < ACCURACY:
            return 0.0, normal
        least = least_along(nearest)
        distance = float(nearest @ least) / length
        if distance > best:
            best, normal = distance, nearest / length
        if best > enough or length - distance < ACCURACY:
            break
        corners, nearer = _nearest_of_hull(np.vstack([corners, least]))
        if not np.linalg.norm(nearer) < length:
            break
        nearest = nearer
    return best, normal


def _nearest_of_hull(
    corners: Float[np.ndarray, "n 3"],
) -> tuple[Float[np.ndarray, "m 3"], Point]:
    """Point of the hull of up to four that is nearest to 0, and those it lies between.

    The last one is among these.
    """
    last = len(corners) - 1
    found, shortest = (corners[last:], corners[last]), np.inf
    for count in range(last + 1):
        for some in itertools.combinations(range(last), count):
            own = corners[[*some, last]]
            edges = own[:-1] - own[-1]
            try:
                shares = np.linalg.solve(edges @ edges.T, -edges @ own[-1])
            except np.linalg.LinAlgError:
                continue
            point = own[-1] + shares @ edges
            length = np.linalg.norm(point)
            if np.all(shares > 0) and shares.sum() < 1 and length < shortest:
                found, shortest = (own, point), length
    return found
