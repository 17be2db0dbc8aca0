"""Where a ray meets a plane, in 50 digits, as three equations in three unknowns."""

__all__ = ["answer", "hit_margin"]

from collections.abc import Sequence

import mpmath as mp

from experiments.oracle.cylinder import DIGITS, Answer, vector


def answer(
    origin: Sequence[float],
    direction: Sequence[float],
    point: Sequence[float],
    normal: Sequence[float],
) -> Answer:
    """Solve o + t d = p + x u + y v, with u and v across the normal.

    The derivative is in point (3), normal (3, as it is given), origin (3) and
    direction (3). `entering` is whether the ray comes from the side of the normal.
    """
    with mp.workdps(DIGITS):
        o, d, p, n = (vector(v) for v in (origin, direction, point, normal))
        k = min(range(3), key=lambda i: abs(n[i]))
        u = _cross(n, [mp.mpf(i == k) for i in range(3)])
        v = _cross(n, u)
        system = mp.matrix([[d[i], -u[i], -v[i]] for i in range(3)])
        size = mp.norm(n) * mp.norm(u) * mp.norm(v) * mp.norm(d)
        if abs(mp.det(system)) < mp.mpf(10) ** (5 - DIGITS) * size:
            return Answer(None, None, False, False, None)
        t, x, y = mp.lu_solve(system, [a - b for a, b in zip(p, o, strict=True)])
        if t <= 0:
            return Answer(None, None, False, False, None)
        q = [x * a + y * b for a, b in zip(u, v, strict=True)]
        n_d = mp.fdot(n, d)
        gradient = [*(-a for a in n), *q, *n, *(t * a for a in n)]
        length = mp.norm(n) * (-1 if n_d > 0 else 1)
        facing = [a / length for a in n]
        return Answer(t, facing, False, n_d < 0, [-a / n_d for a in gradient])


def _cross(a, b):
    return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]


def hit_margin(
    origin: Sequence[float],
    direction: Sequence[float],
    point: Sequence[float],
    normal: Sequence[float],
) -> float:
    """Relative change of the inputs that turns a hit into a miss or back.

    The hit is ahead if n.(p - o) and n.d have one sign.
    """
    with mp.workdps(DIGITS):
        o, d, p, n = (vector(v) for v in (origin, direction, point, normal))
        height = [[a * b, -a * c] for a, b, c in zip(n, p, o, strict=True)]
        slope = [[a * b] for a, b in zip(n, d, strict=True)]
        margins = []
        for terms in (height, slope):
            # Of a component's terms the sum moves with n, each with its other factor.
            moved = [abs(x) for parts in terms for x in (sum(parts), *parts)]
            total = mp.fsum(sum(parts) for parts in terms)
            margins.append(abs(total) / mp.fsum(moved) if any(moved) else mp.mpf(0))
        return float(min(margins))
