"""First surface of a capped cylinder on a ray, in 50 digits.

The textbook way: the wall's quadratic b^2 - ac in the frame of the axis, the two planes
of the caps, and each candidate tested against the other surface. In 50 digits nothing
of it cancels to a degree that matters. Inputs are the rounded numbers that the package
is given; the axis is made a unit vector here, in all digits.
"""

__all__ = ["DIGITS", "Answer", "Vector", "answer", "vector"]

import dataclasses
from collections.abc import Sequence

import mpmath as mp

DIGITS = 50

Vector = list[mp.mpf]


@dataclasses.dataclass(frozen=True)
class Answer:
    """What a ray meets first.

    Attributes:
        t: Ray parameter; None on a miss.
        normal: Unit normal that faces the ray's origin.
        on_cap: Whether the surface is a cap.
        entering: Whether the ray enters the solid there.
        derivative: Of t in center (3), axis (3, its part across the axis), radius,
            height, origin (3) and direction (3); None where the ray only grazes.
    """

    t: mp.mpf | None
    normal: Vector | None
    on_cap: bool
    entering: bool
    derivative: Vector | None


def answer(
    origin: Sequence[float],
    direction: Sequence[float],
    center: Sequence[float],
    axis: Sequence[float],
    radius: float,
    height: float,
) -> Answer:
    """First surface in front of the origin; from inside, the one where it leaves."""
    with mp.workdps(DIGITS):
        o, d, c, a = (vector(v) for v in (origin, direction, center, axis))
        r, h = mp.mpf(float(radius)), mp.mpf(float(height)) / 2
        length = mp.sqrt(mp.fdot(a, a))
        a = [x / length for x in a]
        w = [x - y for x, y in zip(o, c, strict=True)]
        # Of the ray: along the axis, and across it.
        w_a, d_a = mp.fdot(w, a), mp.fdot(d, a)
        w_c = [x - w_a * y for x, y in zip(w, a, strict=True)]
        d_c = [x - d_a * y for x, y in zip(d, a, strict=True)]
        wall = _wall(w_c, d_c, r)
        slab = _slab(w_a, d_a, h)
        low, high = max(wall[0], slab[0]), min(wall[1], slab[1])
        if low > high or high <= 0:
            return Answer(None, None, False, False, None)
        entering = low > 0
        t = low if entering else high
        bounds = (slab[0], wall[0]) if entering else (wall[1], slab[1])
        on_cap = bounds[0] > bounds[1]
        return _seen(o, d, c, a, t, on_cap, entering)


def _seen(o, d, c, a, t, on_cap, entering) -> Answer:
    p = [x + t * y for x, y in zip(o, d, strict=True)]
    q = [x - y for x, y in zip(p, c, strict=True)]
    q_a = mp.fdot(q, a)
    radial = [x - q_a * y for x, y in zip(q, a, strict=True)]
    if on_cap:
        end = 1 if q_a > 0 else -1
        n = [end * x for x in a]
        # F = end (p - c).a - h
        d_axis = [end * x for x in radial]
        sizes = (mp.mpf(0), -mp.mpf(1) / 2)
    else:
        size = mp.sqrt(mp.fdot(radial, radial))
        n = [x / size for x in radial]
        # F = |p - c - ((p - c).a) a| - r
        d_axis = [-q_a * x for x in n]
        sizes = (-mp.mpf(1), mp.mpf(0))
    n_d = mp.fdot(n, d)
    gradient = [*(-x for x in n), *d_axis, *sizes, *n, *(t * x for x in n)]
    derivative = [-x / n_d for x in gradient] if n_d else None
    facing = [-x for x in n] if n_d > 0 else n
    return Answer(t, facing, on_cap, entering, derivative)


def _wall(w: Vector, d: Vector, r: mp.mpf) -> tuple[mp.mpf, mp.mpf]:
    """Stretch of the ray within the radius; w and d are across the axis."""
    a, b, c = mp.fdot(d, d), mp.fdot(w, d), mp.fdot(w, w) - r * r
    if a == 0:
        return (-mp.inf, mp.inf) if c <= 0 else (mp.inf, -mp.inf)
    discriminant = b * b - a * c
    if discriminant < 0:
        return mp.inf, -mp.inf
    root = mp.sqrt(discriminant)
    return (-b - root) / a, (-b + root) / a


def _slab(w: mp.mpf, d: mp.mpf, h: mp.mpf) -> tuple[mp.mpf, mp.mpf]:
    """Stretch of the ray between the planes of the caps."""
    if d == 0:
        return (-mp.inf, mp.inf) if abs(w) <= h else (mp.inf, -mp.inf)
    first, second = (-h - w) / d, (h - w) / d
    return min(first, second), max(first, second)


def vector(values: Sequence[float]) -> Vector:
    """Take the numbers as they are rounded."""
    return [mp.mpf(float(value)) for value in values]
