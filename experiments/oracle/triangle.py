"""Where a ray meets a triangle, in 50 digits, and how surely the inputs tell it.

The plane's equation, and the parts of the corners in the point where the ray crosses
it. Inputs are the rounded numbers that the package is given.
"""

__all__ = ["Crossing", "ahead_margin", "beside_margin", "crossing"]

import dataclasses
from collections.abc import Sequence

import mpmath as mp
import numpy as np

from experiments.oracle.cylinder import DIGITS, Vector, vector

SIDES = ((0, 1), (1, 2), (2, 0))


@dataclasses.dataclass(frozen=True)
class Crossing:
    """Where the line of a ray crosses the plane of a triangle.

    Attributes:
        t: Ray parameter; negative behind the origin.
        is_within: Whether the triangle is there, its edges included.
        normal: Unit normal that faces the ray's origin.
        condition: How many times t changes what the corners, each by its part, origin
            and direction change by, all as parts of their lengths.
        sine: Of the triangle's largest angle.
        derivative: Of t in corners (9, one after the other), origin (3) and direction
            (3).
    """

    t: mp.mpf
    is_within: bool
    normal: Vector
    condition: mp.mpf
    sine: mp.mpf
    derivative: Vector


def crossing(
    origin: Sequence[float], direction: Sequence[float], vertices: np.ndarray
) -> Crossing | None:
    """None where the ray is parallel to the plane."""
    with mp.workdps(DIGITS):
        o, d, corners = _read(origin, direction, vertices)
        a, b, c = corners
        normal = _cross(_minus(b, a), _minus(c, a))
        area, slope = mp.norm(normal), mp.fdot(normal, d)
        if slope == 0:
            return None
        t = mp.fdot(normal, _minus(a, o)) / slope
        point = [x + t * y for x, y in zip(o, d, strict=True)]
        parts = [
            mp.fdot(
                normal, _cross(_minus(corners[j], point), _minus(corners[k], point))
            )
            / area**2
            for j, k in ((1, 2), (2, 0), (0, 1))
        ]
        lengths = mp.fdot(map(abs, parts), map(mp.norm, corners))
        lengths += mp.norm(o) + abs(t) * mp.norm(d)
        sizes = sorted(mp.norm(_minus(corners[j], corners[k])) for j, k in SIDES)
        move = [x / slope for x in normal]
        return Crossing(
            t,
            min(parts) >= 0,
            [-x / area * mp.sign(slope) for x in normal],
            lengths * area / (abs(t * slope)) if t else mp.inf,
            area / (sizes[0] * sizes[1]),
            [part * x for part in parts for x in move]
            + [-x for x in move]
            + [-t * x for x in move],
        )


def ahead_margin(*fields) -> float:
    """Relative change of all lengths that moves the plane to the ray's other end."""
    with mp.workdps(DIGITS):
        o, _, corners = _read(*fields)
        found = crossing(*fields)
        if found is None:
            return 0.0
        above = abs(mp.fdot(found.normal, _minus(corners[0], o)))
        return float(above / (mp.norm(o) + max(map(mp.norm, corners))))


def beside_margin(*fields) -> float:
    """Relative change of all lengths that lets the ray's line meet the triangle.

    To first order: the distance from it over what the triangle's nearest point, the
    origin and the point of the ray there are moved by.
    """
    with mp.workdps(DIGITS):
        o, d, corners = _read(*fields)
        found = crossing(*fields)
        if found is not None and found.is_within:
            return 0.0
        square = mp.fdot(d, d)
        offsets = [_minus(corner, o) for corner in corners]
        feet = [mp.fdot(v, d) / square for v in offsets]
        q = [
            [x - t * y for x, y in zip(v, d, strict=True)]
            for v, t in zip(offsets, feet, strict=True)
        ]
        return float(min(_edge_margin(o, d, corners, feet, q, j, k) for j, k in SIDES))


def _edge_margin(o, d, corners, feet, q, j, k) -> mp.mpf:
    edge = _minus(q[k], q[j])
    square = mp.fdot(edge, edge)
    s = -mp.fdot(q[j], edge) / square if square else mp.mpf(0)
    s = min(max(s, mp.mpf(0)), mp.mpf(1))
    apart = mp.norm([x + s * y for x, y in zip(q[j], edge, strict=True)])
    moved = (1 - s) * mp.norm(corners[j]) + s * mp.norm(corners[k]) + mp.norm(o)
    return apart / (moved + abs((1 - s) * feet[j] + s * feet[k]) * mp.norm(d))


def _read(origin, direction, vertices):
    return vector(origin), vector(direction), [vector(v) for v in np.asarray(vertices)]


def _minus(v: Vector, w: Vector) -> Vector:
    return [x - y for x, y in zip(v, w, strict=True)]


def _cross(v: Vector, w: Vector) -> Vector:
    return [
        v[1] * w[2] - v[2] * w[1],
        v[2] * w[0] - v[0] * w[2],
        v[0] * w[1] - v[1] * w[0],
    ]
