"""First surface of a torus on a ray, in 50 digits, by its quartic; and extreme rays.

With q the point relative to the center and h its height along the axis, it is

    (q.q + R^2 - r^2)^2 = 4 R^2 (q.q - h^2),

a polynomial of the ray parameter, whose zeros are found together. The derivative is
that of the distance from the surface, written out.
"""

__all__ = ["Answer", "TorusRays", "answer", "extreme_tori"]

import dataclasses
from collections.abc import Sequence

import mpmath as mp
import numpy as np
from jaxtyping import Float

from experiments.oracle.cylinder import DIGITS, Vector, vector
from experiments.oracle.extremes import Draws, across


@dataclasses.dataclass(frozen=True)
class TorusRays:
    """One ray and one torus in each row; every number is exact in the dtype."""

    origin: Float[np.ndarray, "n 3"]
    direction: Float[np.ndarray, "n 3"]
    center: Float[np.ndarray, "n 3"]
    axis: Float[np.ndarray, "n 3"]
    major_radius: Float[np.ndarray, " n"]
    minor_radius: Float[np.ndarray, " n"]


@dataclasses.dataclass(frozen=True)
class Answer:
    """What a ray meets first.

    Attributes:
        t: Ray parameter; None on a miss.
        normal: Unit normal that faces the ray's origin.
        derivative: Of t in origin, direction, center, axis and both radii.
        margin: Relative change of the inputs that makes the ray graze, or start on the
            surface: up to it the decisions are sure.
    """

    t: mp.mpf | None
    normal: Vector | None
    derivative: Vector | None
    margin: mp.mpf


def answer(*fields: Sequence[float] | float) -> Answer:
    """First surface in front of the origin; from inside, the one where it leaves.

    Args:
        fields: Those of `TorusRays`; the axis need not be of unit length.
    """
    with mp.workdps(DIGITS):
        o, d, c, a = (vector(v) for v in fields[:4])
        large, small = (mp.mpf(float(v)) for v in fields[4:])
        a = [x / mp.sqrt(mp.fdot(a, a)) for x in a]
        w = [x - y for x, y in zip(o, c, strict=True)]
        # From the nearest point to the center, and in lengths: there it is well scaled.
        speed = mp.sqrt(mp.fdot(d, d))
        foot = -mp.fdot(w, d) / speed**2
        unit_d = [x / speed for x in d]
        p = [x + foot * y for x, y in zip(w, d, strict=True)]
        p_p, h, rise = mp.fdot(p, p), mp.fdot(p, a), mp.fdot(unit_d, a)
        rest = p_p + large**2 - small**2
        quartic = [
            mp.mpf(1),
            mp.mpf(0),
            2 * rest - 4 * large**2 * (1 - rise**2),
            8 * large**2 * h * rise,
            rest**2 - 4 * large**2 * (p_p - h**2),
        ]
        slope = [n * x for n, x in zip((4, 3, 2, 1), quartic[:4], strict=True)]
        places = [foot + x / speed for x in _real_roots(quartic)]
        turns = [foot + x / speed for x in _real_roots(slope)]
        margins = []
        for t in (mp.mpf(0), *(t for t in turns if t > 0)):
            gap, _, partial = _differentiate(o, d, c, a, large, small, t)
            change = mp.fsum(
                abs(x * y) for x, y in zip(_flat(fields), partial, strict=True)
            )
            margins.append(abs(gap) / change)
        ahead = [t for t in places if t > 0]
        if not ahead:
            return Answer(None, None, None, min(margins))
        t = min(ahead)
        _, n, partial = _differentiate(o, d, c, a, large, small, t)
        n_d = mp.fdot(n, d)
        if not n_d:
            return Answer(t, None, None, mp.mpf(0))
        facing = [-x for x in n] if n_d > 0 else n
        return Answer(t, facing, [-x / n_d for x in partial], min(margins))


def _flat(fields) -> list[mp.mpf]:
    return [mp.mpf(float(x)) for field in fields for x in np.ravel(field)]


def _real_roots(coefficients: Vector) -> list[mp.mpf]:
    """Those of a polynomial, a double one to half of the digits among them."""
    roots = mp.polyroots(
        coefficients[::-1], maxsteps=500, extraprec=4 * DIGITS, asc=True
    )
    size = max(abs(x) for x in roots)
    few = size * mp.mpf(10) ** (-DIGITS // 2)
    return [mp.re(x) for x in roots if abs(mp.im(x)) <= few]


def _differentiate(o, d, c, a, large, small, t) -> tuple[mp.mpf, Vector, Vector]:
    """Distance from the surface at t, its gradient, and its derivative in the fields.

    That in the axis is across it.
    """
    q = [x + t * y - z for x, y, z in zip(o, d, c, strict=True)]
    h = mp.fdot(q, a)
    out = [x - h * y for x, y in zip(q, a, strict=True)]
    rho = mp.sqrt(mp.fdot(out, out))
    out = [x / rho for x in out] if rho else out
    off = mp.sqrt((rho - large) ** 2 + h**2)
    cosine, sine = ((rho - large) / off, h / off) if off else (mp.mpf(1), mp.mpf(0))
    n = [cosine * x + sine * y for x, y in zip(out, a, strict=True)]
    turned = [(sine * rho - cosine * h) * x for x in out]
    flat = [*n, *(t * x for x in n), *(-x for x in n), *turned, -cosine, mp.mpf(-1)]
    return off - small, n, flat


def extreme_tori(count: int, seed: int, dtype: str = "float32") -> TorusRays:
    """Draw rays; each extreme is met by a good part of them, most by several.

    Scale of the scene 1e-6 to 1e6; distance over major radius from inside over
    1 + 1e-6 to 1e6; minor radius from 1e-4 of the major one to 1e-6 below it; the axis
    anywhere, or within 1e-7 rad of the ray, of a plane across it or of a coordinate
    axis; the ray towards a point on the surface, within 1e-6 of grazing it, through the
    hole, or anywhere.

    Args:
        count: Number of rays.
        seed: Of the draws.
        dtype: Numbers are rounded to it; the axis is rounded after it is a unit vector.
    """
    draws = Draws(count, seed)
    rng, log_uniform, choose = draws.rng, draws.log_uniform, draws.choose
    view, axis = draws.view_and_axis()
    thin, thick = log_uniform(1e-4, 1), 1 - log_uniform(1e-6, 0.5)
    minor = np.where(rng.uniform(size=count) < 0.7, thin, thick)
    u = across(axis)
    angle, turn = rng.uniform(0, 2 * np.pi, (2, count))[:, :, None]
    out = np.cos(angle) * u + np.sin(angle) * np.cross(axis, u)
    n = np.cos(turn) * out + np.sin(turn) * axis
    # Of the normals at a place of the ring, one across the ray: there it is grazed.
    tangent = np.cross(out, axis)
    edge = np.cross(view, tangent)
    edge /= np.maximum(np.linalg.norm(edge, axis=-1, keepdims=True), 1e-300)
    graze = 1 + (log_uniform(1e-9, 1e-3) * np.sign(rng.uniform(-1, 1, count)))[:, None]
    r = minor[:, None]
    target = choose(
        [0.45, 0.25, 0.15, 0.15],
        out + r * n,
        out + r * edge * graze,
        (1 - r) * rng.uniform(0, 1, (count, 1)) * out,
        3 * rng.normal(size=(count, 3)),
    )
    origin, direction, center, scale = draws.cameras(target, view)
    major = scale[:, 0]
    values = (origin, direction, center, axis, major, minor * major)
    return TorusRays(*(value.astype(dtype) for value in values))
