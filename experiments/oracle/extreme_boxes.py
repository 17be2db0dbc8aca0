"""Random rays at random boxes, over all the extremes together."""

__all__ = ["BoxRays", "extreme_boxes"]

import dataclasses

import numpy as np
from jaxtyping import Float

from experiments.oracle.extremes import Draws, across


@dataclasses.dataclass(frozen=True)
class BoxRays:
    """One ray and one box in each row; every number is exact in the dtype."""

    origin: Float[np.ndarray, "n 3"]
    direction: Float[np.ndarray, "n 3"]
    center: Float[np.ndarray, "n 3"]
    rotation: Float[np.ndarray, "n 3 3"]
    size: Float[np.ndarray, "n 3"]


def extreme_boxes(count: int, seed: int, dtype: str = "float32") -> BoxRays:
    """Draw rays; each extreme is met by a good part of them, most by several.

    Scale of the scene 1e-6 to 1e6; edges in the ratio 1e-4 to 1e4; one edge anywhere,
    or within 1e-7 rad of the ray, of a plane across it or of a coordinate axis, a tenth
    of the boxes along the coordinate axes; the ray towards a point in a face, on an
    edge, a corner, within 1e-6 of them, a face's center, or anywhere; from a distance
    of 1 + 1e-6 to 1e6, from inside or from a face.

    Args:
        count: Number of rays.
        seed: Of the draws.
        dtype: Numbers are rounded to it.
    """
    draws = Draws(count, seed)
    rng, log_uniform, choose = draws.rng, draws.log_uniform, draws.choose
    view, axis = draws.view_and_axis()
    u = across(axis)
    angle = rng.uniform(0, 2 * np.pi, count)[:, None]
    first = np.cos(angle) * u + np.sin(angle) * np.cross(axis, u)
    rotation = np.stack([first, np.cross(axis, first), axis], axis=-1)
    rotation[rng.uniform(size=count) < 0.1] = np.eye(3)
    half = np.stack([np.ones(count), log_uniform(1e-4, 1e4), log_uniform(1e-4, 1e4)], 1)
    half[rng.uniform(size=count) < 0.3, 1] = 1

    def placed(local):
        """From the frame of the box, counted in half-edges, to the world."""
        return np.einsum("nij,nj->ni", rotation, half * local)

    def on_face(free):
        """Of three coordinates in [-1, 1], at least 3 - free at an end, exactly."""
        place = rng.uniform(-1, 1, (count, 3))
        order = np.argsort(rng.uniform(size=(count, 3)), axis=1)
        return np.where(order >= free, np.sign(place), place)

    in_face, edge, corner = on_face(2), on_face(1), on_face(0)
    graze = 1 + (log_uniform(1e-9, 1e-3) * np.sign(rng.uniform(-1, 1, count)))[:, None]
    target = choose(
        [0.35, 0.15, 0.1, 0.2, 0.05, 0.15],
        in_face,
        edge,
        corner,
        edge * graze,
        np.where(np.abs(in_face) == 1, in_face, 0),
        3 * rng.normal(size=(count, 3)),
    )
    target = placed(target)
    afar = target - view * (1 + log_uniform(1e-6, 1e6))[:, None]
    inside = placed(rng.uniform(-1, 1, (count, 3)))
    origin = choose([0.75, 0.15, 0.1], afar, inside, placed(on_face(2)))
    direction = target - origin
    direction /= np.max(np.abs(direction), axis=1, keepdims=True)
    origin, center, scale, _ = draws.placed(origin)
    rounded = (origin, direction, center, rotation, 2 * half * scale)
    return BoxRays(*(value.astype(dtype) for value in rounded))
