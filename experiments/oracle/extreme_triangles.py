"""Random rays at random triangles, over all the extremes together."""

__all__ = ["TriangleRays", "extreme_triangles"]

import dataclasses

import numpy as np
from jaxtyping import Float

from experiments.oracle.extremes import Draws, across


@dataclasses.dataclass(frozen=True)
class TriangleRays:
    """One ray and one triangle in each row; every number is exact in the dtype."""

    origin: Float[np.ndarray, "n 3"]
    direction: Float[np.ndarray, "n 3"]
    vertices: Float[np.ndarray, "n 3 3"]


def extreme_triangles(count: int, seed: int, dtype: str = "float32") -> TriangleRays:
    """Draw rays; each extreme is met by a good part of them, most by several.

    Scale of the scene 1e-6 to 1e6; the height of a triangle 1e-4 to 1e2 of its base,
    over the base or beside it; its normal anywhere, or within 1e-7 rad of the ray, of a
    plane across it or of a coordinate axis; the ray towards a point in the triangle, on
    an edge, a corner, within 1e-6 of them, or anywhere; from a distance of 1e-6 to 1e6.

    Args:
        count: Number of rays.
        seed: Of the draws.
        dtype: Numbers are rounded to it.
    """
    draws = Draws(count, seed)
    rng, log_uniform, choose = draws.rng, draws.log_uniform, draws.choose
    view, normal = draws.view_and_axis()
    u = across(normal)
    angle = rng.uniform(0, 2 * np.pi, count)[:, None]
    base = np.cos(angle) * u + np.sin(angle) * np.cross(normal, u)
    height = np.cross(normal, base) * log_uniform(1e-4, 1e2)[:, None]
    aside = rng.uniform(-0.5, 1.5, count)[:, None] * base
    corners = np.stack([0 * base, base, aside + height], axis=1)
    order = np.argsort(rng.uniform(size=(count, 3)), axis=1)
    corners = corners[np.arange(count)[:, None], order]

    parts = rng.dirichlet((1, 1, 1), count)
    edge = parts * [1, 1, 0] / np.maximum(1 - parts[:, 2:], 1e-9)
    graze = 1 + (log_uniform(1e-9, 1e-3) * np.sign(rng.uniform(-1, 1, count)))[:, None]
    corner = np.broadcast_to((1.0, 0.0, 0.0), parts.shape)
    beside = edge * graze + (1 - graze) * [0, 0, 1]
    target = choose(
        [0.4, 0.15, 0.1, 0.15, 0.05, 0.15],
        parts,
        edge,
        corner,
        beside,
        graze * corner + (1 - graze) * parts,
        rng.dirichlet((1, 1, 1), count) * 3 - 2 / 3,
    )
    target = np.einsum("nk,nki->ni", target, corners)
    origin = target - view * log_uniform(1e-6, 1e6)[:, None]
    direction = target - origin
    direction /= np.max(np.abs(direction), axis=1, keepdims=True)
    origin, center, scale, _ = draws.placed(origin)
    vertices = center[:, None] + corners * scale[:, None]
    values = (origin, direction, vertices)
    return TriangleRays(*(value.astype(dtype) for value in values))
