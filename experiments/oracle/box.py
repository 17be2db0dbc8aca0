"""First face of a box on a ray, in 50 digits, and how surely the inputs tell it.

Each of the six faces is a candidate: the ray meets its plane, and the point is tested
against the edges. The nearest that passes is seen. Inputs are the rounded numbers that
the package is given; the columns of the rotation are taken as they are.
"""

__all__ = ["answer", "face_margin", "hit_margin"]

from collections.abc import Sequence

import mpmath as mp
import numpy as np

from experiments.oracle.cylinder import DIGITS, Answer, Vector, vector


def answer(
    origin: Sequence[float],
    direction: Sequence[float],
    center: Sequence[float],
    rotation: np.ndarray,
    size: Sequence[float],
) -> Answer:
    """First face in front of the origin; from inside, the one where it leaves.

    The derivative is in center (3), rotation (9, row by row), size (3), origin (3) and
    direction (3).
    """
    with mp.workdps(DIGITS):
        o, d, c, axes, half = _read(origin, direction, center, rotation, size)
        w = [x - y for x, y in zip(o, c, strict=True)]
        passed = []
        for k in range(3):
            slope = mp.fdot(axes[k], d)
            if slope == 0:
                continue
            for side in (-1, 1):
                t = (side * half[k] - mp.fdot(axes[k], w)) / slope
                q = [x + t * y for x, y in zip(w, d, strict=True)]
                others = [j for j in range(3) if j != k]
                within = all(abs(mp.fdot(axes[j], q)) <= half[j] for j in others)
                if t > 0 and within:
                    passed.append((t, side * slope > 0, k, side, slope))
        if not passed:
            return Answer(None, None, False, False, None)
        # On an edge that the ray only touches, the face that it enters.
        t, leaves, k, side, slope = min(passed)
        length = mp.norm(axes[k]) * mp.sign(slope)
        facing = [-x / length for x in axes[k]]
        derivative = _slopes(w, d, axes, k, side, t)
        return Answer(t, facing, False, not leaves, derivative)


def hit_margin(*fields) -> float:
    """Relative change of the inputs that turns a hit into a miss or back."""
    with mp.workdps(DIGITS):
        lower, upper, beside = _bounds(*fields)
        is_hit, reasons = True, []
        for j, first in lower.items():
            for k, last in upper.items():
                if j != k:
                    reasons.append((first[0] <= last[0], _sure(fields, last, first)))
        reasons += [(last[0] > 0, _sure(fields, last)) for last in upper.values()]
        reasons += beside
        is_hit = all(holds for holds, _ in reasons)
        # A miss ends when the last of its reasons does.
        if is_hit:
            return float(min(margin for _, margin in reasons))
        return float(max(margin for holds, margin in reasons if not holds))


def face_margin(*fields) -> float:
    """Relative change of the inputs that makes another face the first."""
    with mp.workdps(DIGITS):
        lower, upper, _ = _bounds(*fields)
        enter = max(bound[0] for bound in lower.values())
        starts = [_sure(fields, bound) for bound in lower.values()]
        if enter > 0:
            k = max(lower, key=lambda j: lower[j][0])
            bounds, margins = lower, [_sure(fields, lower[k])]
        else:
            k = min(upper, key=lambda j: upper[j][0])
            bounds, margins = upper, starts
        margins += [_sure(fields, bounds[k], bounds[j]) for j in bounds if j != k]
        return float(min(margins))


def _read(origin, direction, center, rotation, size):
    axes = [vector(np.asarray(rotation)[:, k]) for k in range(3)]
    half = [x / 2 for x in vector(size)]
    return vector(origin), vector(direction), vector(center), axes, half


def _slopes(w, d, axes, k, side, t) -> Vector:
    """Derivative of t from side (a . (w + t d)) = h, with a the axis k."""
    a, slope = axes[k], mp.fdot(axes[k], d)
    q = [x + t * y for x, y in zip(w, d, strict=True)]
    turn = [-q[i] / slope if j == k else mp.mpf(0) for i in range(3) for j in range(3)]
    grow = [side / slope / 2 if j == k else mp.mpf(0) for j in range(3)]
    move = [x / slope for x in a]
    return [*move, *turn, *grow, *(-x for x in move), *(-t * x for x in move)]


def _bounds(*fields):
    """Where the ray enters and leaves each slab, each with its slopes.

    A ray parallel to a slab has no bounds, but is beside it or not: that, and how sure.
    """
    o, d, c, axes, half = _read(*fields)
    w = [x - y for x, y in zip(o, c, strict=True)]
    lower, upper, beside = {}, {}, []
    for k in range(3):
        slope, level = mp.fdot(axes[k], d), mp.fdot(axes[k], w)
        if slope == 0:
            parts = [abs(a) * (abs(x) + abs(y))
                     for a, x, y in zip(axes[k], o, c, strict=True)]  # fmt: skip
            gap = half[k] - abs(level)
            beside.append((gap >= 0, abs(gap) / (mp.fsum(parts) + half[k])))
            continue
        ends = {}
        for side in (-1, 1):
            t = (side * half[k] - level) / slope
            ends[side * mp.sign(slope)] = (t, _slopes(w, d, axes, k, side, t))
        lower[k], upper[k] = ends[-1], ends[1]
    return lower, upper, beside


def _sure(fields, first, second=None) -> mp.mpf:
    """Relative change of the inputs at which two bounds, or one and 0, are equal."""
    second = (mp.mpf(0), [mp.mpf(0)] * 21) if second is None else second
    origin, direction, center, rotation, size = map(np.asarray, fields)
    values = vector([*center, *rotation.ravel(), *size, *origin, *direction])
    slopes = (x - y for x, y in zip(first[1], second[1], strict=True))
    moved = mp.fsum(abs(x * s) for x, s in zip(values, slopes, strict=True))
    return abs(first[0] - second[0]) / moved if moved else mp.inf
