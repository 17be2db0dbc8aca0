"""First surface of a frustum, whole or a sector, in 50 digits.

Every surface is met on its own and each candidate tested: the wall's quadratic b^2 - ac
with its place between the ends, the planes of the ends, the half-planes of the cut,
and the angle of a point by the arc tangent. Derivatives are those of the equation of
the surface that is met, by differences of a 25th digit.
"""

__all__ = ["Answer", "answer", "frustum_rays"]

import dataclasses
from collections.abc import Callable, Sequence

import mpmath as mp
import numpy as np
from jaxtyping import Float

from experiments.oracle.cylinder import DIGITS, Vector, vector

STEP = mp.mpf(10) ** -25

Inputs = list[mp.mpf]
"""Origin (3), direction (3), p1 (3), p2 (3), radius1, radius2, then start and end."""


@dataclasses.dataclass(frozen=True)
class Answer:
    """What a ray meets first.

    Attributes:
        t: Ray parameter; None on a miss.
        part: 0 wall, 1 and 2 the caps at p1 and p2, 3 and 4 the faces of the cut.
        normal: Unit normal that faces the ray's origin.
        derivative: Of t in the inputs.
    """

    t: mp.mpf | None
    part: int | None
    normal: Vector | None
    derivative: Vector | None


def answer(
    inputs: Sequence[float],
    zero: Sequence[float] | None = None,
    caps: bool = True,
    cut_faces: bool = True,
) -> Answer:
    """First surface in front of the origin.

    Args:
        inputs: Origin, direction, p1, p2, radius1, radius2 and, for a sector, its start
            and end angle.
        zero: Direction of the angle 0; None for the whole turn.
        caps: Whether the ends are closed.
        cut_faces: Whether the cut is closed.
    """
    with mp.workdps(DIGITS):
        x = vector(inputs)
        z = None if zero is None else vector(zero)
        best = None
        for part, t in _candidates(x, z):
            closed = (True, caps, caps, cut_faces, cut_faces)[part]
            if closed and t > 0 and (best is None or t < best[1]):
                best = part, t
        if best is None:
            return Answer(None, None, None, None)
        part, t = best
        normal, derivative = _differentiate(x, z, part, t)
        return Answer(t, part, normal, derivative)


def _frame(x: Inputs) -> tuple[Vector, Vector, Vector, mp.mpf, Vector]:
    """Origin relative to p1, direction, unit axis, length, and p1."""
    o, d, p1, p2 = x[0:3], x[3:6], x[6:9], x[9:12]
    way = [b - a for a, b in zip(p1, p2, strict=True)]
    length = mp.sqrt(mp.fdot(way, way))
    w = [a - b for a, b in zip(o, p1, strict=True)]
    return w, d, [v / length for v in way], length, p1


def _cut(a: Vector, zero: Vector) -> tuple[Vector, Vector]:
    along = mp.fdot(zero, a)
    first = [v - along * n for v, n in zip(zero, a, strict=True)]
    size = mp.sqrt(mp.fdot(first, first))
    first = [v / size for v in first]
    second = [
        a[1] * first[2] - a[2] * first[1],
        a[2] * first[0] - a[0] * first[2],
        a[0] * first[1] - a[1] * first[0],
    ]
    return first, second


def _candidates(x: Inputs, zero: Vector | None):
    w, d, a, length, _ = _frame(x)
    r1, r2 = x[12], x[13]
    slope = (r2 - r1) / length
    w_a, d_a = mp.fdot(w, a), mp.fdot(d, a)
    w_c = [u - w_a * n for u, n in zip(w, a, strict=True)]
    d_c = [u - d_a * n for u, n in zip(d, a, strict=True)]
    rho, k = r1 + slope * w_a, slope * d_a
    first, second = _cut(a, zero) if zero is not None else (None, None)

    def inside_turn(t: mp.mpf) -> bool:
        if zero is None:
            return True
        q = [u + t * v for u, v in zip(w_c, d_c, strict=True)]
        angle = mp.atan2(mp.fdot(q, second), mp.fdot(q, first))
        turn = 2 * mp.pi
        return (angle - x[14]) % turn <= (x[15] - x[14]) % turn

    def out(t: mp.mpf) -> mp.mpf:
        q = [u + t * v for u, v in zip(w_c, d_c, strict=True)]
        return mp.sqrt(mp.fdot(q, q))

    for t in _roots(
        mp.fdot(d_c, d_c) - k * k, mp.fdot(w_c, d_c) - rho * k,
        mp.fdot(w_c, w_c) - rho * rho,
    ):  # fmt: skip
        if 0 <= w_a + t * d_a <= length and inside_turn(t):
            yield 0, t
    for part, level, radius in ((1, mp.mpf(0), r1), (2, length, r2)):
        if d_a:
            t = (level - w_a) / d_a
            if out(t) <= radius and inside_turn(t):
                yield part, t
    if zero is None:
        return
    for part, angle in ((3, x[14]), (4, x[15])):
        cosine, sine = mp.cos(angle), mp.sin(angle)
        edge = [cosine * u + sine * v for u, v in zip(first, second, strict=True)]
        normal = [cosine * v - sine * u for u, v in zip(first, second, strict=True)]
        speed = mp.fdot(d, normal)
        if speed:
            t = -mp.fdot(w, normal) / speed
            reach = mp.fdot(w_c, edge) + t * mp.fdot(d_c, edge)
            level = w_a + t * d_a
            if 0 <= reach <= r1 + slope * level and 0 <= level <= length:
                yield part, t


def _roots(a: mp.mpf, b: mp.mpf, c: mp.mpf) -> list[mp.mpf]:
    if a == 0:
        return [-c / (2 * b)] if b else []
    discriminant = b * b - a * c
    if discriminant < 0:
        return []
    root = mp.sqrt(discriminant)
    return [(-b - root) / a, (-b + root) / a]


def _equation(part: int, zero: Vector | None) -> Callable[[Inputs, mp.mpf], mp.mpf]:
    """Equation of a part in the inputs, at a ray parameter; it grows outward."""

    def value(x: Inputs, t: mp.mpf) -> mp.mpf:
        w, d, a, length, _ = _frame(x)
        q = [u + t * v for u, v in zip(w, d, strict=True)]
        along = mp.fdot(q, a)
        if part == 1:
            return -along
        if part == 2:
            return along - length
        if part == 0:
            aside = [u - along * n for u, n in zip(q, a, strict=True)]
            slope = (x[13] - x[12]) / length
            return mp.sqrt(mp.fdot(aside, aside)) - x[12] - slope * along
        first, second = _cut(a, zero)
        angle = x[14] if part == 3 else x[15]
        sign = -1 if part == 3 else 1
        return sign * (mp.cos(angle) * mp.fdot(q, second) - mp.sin(angle)
                       * mp.fdot(q, first))  # fmt: skip

    return value


def _differentiate(x: Inputs, zero: Vector | None, part: int, t: mp.mpf):
    value = _equation(part, zero)
    at = value(x, t)

    def slope(k: int) -> mp.mpf:
        step = STEP * max(abs(x[k]), abs(t), STEP)
        moved = [*x[:k], x[k] + step, *x[k + 1 :]]
        return (value(moved, t) - at) / step

    gradient = [slope(k) for k in range(len(x))]
    # The gradient in the origin is the surface's own.
    size = mp.sqrt(mp.fdot(gradient[:3], gradient[:3]))
    if not size:
        return None, None
    speed = mp.fdot(gradient[:3], x[3:6])
    sign = -1 if speed > 0 else 1
    normal = [sign * g / size for g in gradient[:3]]
    return normal, [-g / speed for g in gradient] if speed else None


def frustum_rays(count: int, seed: int, dtype: str) -> Float[np.ndarray, "n 14"]:
    """Rays at frusta over the extremes: the inputs of `answer`, exact in the dtype.

    Scale 1e-6 to 1e6, length over radius 1e-3 to 1e3, the other radius 0, equal to a
    part in a million, or anything between; distance over size 1e-6 to 1e6, also from
    inside; rays anywhere, along the axis, along the wall and grazing it, through the
    rim and through the tip.
    """
    rng = np.random.default_rng(seed)

    def log_uniform(low, high):
        return np.exp(rng.uniform(np.log(low), np.log(high), count))

    def unit(v):
        return v / np.linalg.norm(v, axis=-1, keepdims=True)

    def choose(weights, *options):
        kind = rng.choice(len(options), size=count, p=weights)
        return np.choose(kind[:, None], options)

    anywhere = unit(rng.normal(size=(count, 3)))
    coordinate = np.eye(3)[rng.integers(3, size=count)]
    tilt = log_uniform(1e-9, 1e-3)[:, None]
    axis = choose([0.6, 0.4], anywhere, unit(coordinate + tilt * anywhere))
    length = log_uniform(1e-3, 1e3)
    ratio = choose(
        [0.3, 0.1, 0.2, 0.4], *(x[:, None] * np.ones((1, 3)) for x in (
            np.zeros(count), np.ones(count), 1 + log_uniform(1e-7, 1e-3),
            log_uniform(1e-3, 1),
        )))[:, 0]  # fmt: skip
    swapped = rng.uniform(size=count) < 0.5
    r1, r2 = np.where(swapped, ratio, 1), np.where(swapped, 1, ratio)
    u = unit(np.cross(axis, np.eye(3)[np.argmin(np.abs(axis), axis=-1)]))
    v = np.cross(axis, u)
    angle = rng.uniform(0, 2 * np.pi, count)[:, None]
    radial = np.cos(angle) * u + np.sin(angle) * v
    around = np.cos(angle) * v - np.sin(angle) * u
    part = choose([0.7, 0.15, 0.15], *(x[:, None] * np.ones((1, 3)) for x in (
        rng.uniform(size=count), np.zeros(count), np.ones(count))))[:, :1]  # fmt: skip
    radius = (1 - part) * r1[:, None] + part * r2[:, None]
    inward = np.where(
        rng.uniform(size=(count, 1)) < 0.7, 1, rng.uniform(size=(count, 1))
    )
    target = axis * part * length[:, None] + radial * radius * inward
    slope = ((r2 - r1) / length)[:, None]
    wall = unit(axis + slope * radial)
    out = unit(radial - slope * axis)
    mixed = unit(
        wall * rng.normal(size=(count, 1)) + around * rng.normal(size=(count, 1))
    )
    view = choose(
        [0.5, 0.2, 0.15, 0.15],
        unit(rng.normal(size=(count, 3))),
        unit(mixed + out * tilt * np.sign(rng.normal(size=(count, 1)))),
        unit(wall + tilt * anywhere),
        unit(axis + tilt * anywhere),
    )
    clear = log_uniform(1e-6, 1e6)[:, None]
    away = np.where(rng.uniform(size=(count, 1)) < 0.2, 0.3, clear)
    origin = target - view * away * np.maximum(1, length)[:, None] ** 0.5
    scale = log_uniform(1e-6, 1e6)[:, None]
    moved = rng.uniform(size=(count, 1)) < 0.5
    shift = np.where(moved, -origin, 0)
    p1, p2 = shift, axis * length[:, None] + shift
    origin = np.where(moved, 0, origin)
    columns = [
        origin * scale, view, p1 * scale, p2 * scale, r1[:, None] * scale,
        r2[:, None] * scale,
    ]  # fmt: skip
    rays = np.hstack(columns).astype(dtype)
    # A short one far from the origin may be rounded to nothing.
    return rays[np.any(rays[:, 6:9] != rays[:, 9:12], axis=1)]
