"""First surface of a sphere on a ray, in 50 digits, by the textbook's quadratic."""

__all__ = ["answer", "distance"]

from collections.abc import Sequence

import mpmath as mp

from experiments.oracle.cylinder import DIGITS, Answer, vector


def answer(
    origin: Sequence[float],
    direction: Sequence[float],
    center: Sequence[float],
    radius: float,
) -> Answer:
    """First surface in front of the origin; from inside, the one where it leaves.

    The derivative is in center (3), radius, origin (3) and direction (3).
    """
    with mp.workdps(DIGITS):
        o, d, c = (vector(v) for v in (origin, direction, center))
        r = mp.mpf(float(radius))
        w = [x - y for x, y in zip(o, c, strict=True)]
        a, b = mp.fdot(d, d), mp.fdot(w, d)
        discriminant = b * b - a * (mp.fdot(w, w) - r * r)
        if discriminant < 0:
            return Answer(None, None, False, False, None)
        root = mp.sqrt(discriminant)
        enter, leave = (-b - root) / a, (-b + root) / a
        if leave <= 0:
            return Answer(None, None, False, False, None)
        t = enter if enter > 0 else leave
        n = [(x + t * y) / r for x, y in zip(w, d, strict=True)]
        n_d = mp.fdot(n, d)
        gradient = [*(-x for x in n), mp.mpf(-1), *n, *(t * x for x in n)]
        derivative = [-x / n_d for x in gradient] if n_d else None
        facing = [-x for x in n] if n_d > 0 else n
        return Answer(t, facing, False, enter > 0, derivative)


def distance(
    origin: Sequence[float], direction: Sequence[float], center: Sequence[float]
) -> mp.mpf:
    """Distance of the ray's line from the center."""
    with mp.workdps(DIGITS):
        o, d, c = (vector(v) for v in (origin, direction, center))
        w = [x - y for x, y in zip(o, c, strict=True)]
        along, square = mp.fdot(w, d), mp.fdot(d, d)
        return mp.sqrt(mp.fdot(w, w) - along * along / square)
