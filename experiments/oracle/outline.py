"""Distance of a direction from the outline of a cylinder, in 50 digits.

The image of a convex body before the camera is convex, and the signed distance of a
point p from a convex set is the largest n.p - h(n) over all unit vectors n, where h is
the set's support function: how far it reaches along n. The cylinder's is the larger of
its two end discs'. A disc reaches as far along n as the plane through the camera whose
image is the line n.q = h touches it: with l = (n_x, n_y, -h) and l' its part across the
axis, l.c + r |l'| = 0, a quadratic equation in h.
"""

__all__ = ["disc_support", "outline_distance"]

import math
from collections.abc import Sequence

import mpmath as mp

from experiments.oracle.cylinder import DIGITS, vector

NORMALS = 240


def outline_distance(
    place: Sequence[float],
    center: Sequence[float],
    axis: Sequence[float],
    radius: float,
    height: float,
) -> mp.mpf:
    """Signed distance in the plane z = 1, negative inside; all of the body at z > 0."""
    with mp.workdps(DIGITS):
        p, c, a = (vector(v) for v in (place, center, axis))
        r, h = mp.mpf(float(radius)), mp.mpf(float(height)) / 2
        length = mp.sqrt(mp.fdot(a, a))
        a = [x / length for x in a]
        ends = [
            [x + side * h * y for x, y in zip(c, a, strict=True)] for side in (-1, 1)
        ]

        def beyond(angle: mp.mpf) -> mp.mpf:
            n = (mp.cos(angle), mp.sin(angle))
            return _beyond(n, p, ends, a, r, mp.sqrt)

        def roughly(angle: float) -> float:
            n = (math.cos(angle), math.sin(angle))
            return _beyond(n, *rough, math.sqrt)

        # Which angle is near the best one is told in double precision.
        rough = ([float(x) for x in p], [[float(x) for x in end] for end in ends],
                 [float(x) for x in a], float(r))  # fmt: skip
        best = max(range(NORMALS), key=lambda k: roughly(2 * math.pi / NORMALS * k))
        step = 2 * mp.pi / NORMALS
        return _largest(beyond, (best - 1) * step, (best + 1) * step)


def _beyond(n, p, ends, a, r, sqrt):
    """How far a point lies beyond the line across n that touches the image."""
    reach = max(disc_support(n, end, a, r, sqrt) for end in ends)
    return n[0] * p[0] + n[1] * p[1] - reach


def disc_support(n, c, a, r, sqrt):
    """Largest n.q of the disc's image: the outer root in h of the tangent planes."""
    # l = m - h e with m = (n, 0) and e = (0, 0, 1); |l'|^2 = l.l - (l.a)^2.
    m_c, m_a = n[0] * c[0] + n[1] * c[1], n[0] * a[0] + n[1] * a[1]
    first = c[2] ** 2 - r**2 * (1 - a[2] ** 2)
    second = -m_c * c[2] - r**2 * m_a * a[2]
    third = m_c**2 - r**2 * (1 - m_a**2)
    root = sqrt(max(second**2 - first * third, 0))
    return (-second + root) / first


def _largest(function, low, high) -> mp.mpf:
    """Maximum between two angles by golden section, to 25 digits of the angle."""
    ratio = (mp.sqrt(5) - 1) / 2
    inner = [high - ratio * (high - low), low + ratio * (high - low)]
    values = [function(x) for x in inner]
    for _ in range(60):
        if values[0] > values[1]:
            high, inner[1], values[1] = inner[1], inner[0], values[0]
            inner[0] = high - ratio * (high - low)
            values[0] = function(inner[0])
        else:
            low, inner[0], values[0] = inner[0], inner[1], values[1]
            inner[1] = low + ratio * (high - low)
            values[1] = function(inner[1])
    return max(values)
