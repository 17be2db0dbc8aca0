"""Which rays see what an oracle does not, and whether rounding excuses it."""

__all__ = ["EXCUSED", "Judged", "judge", "rays_at"]

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from experiments.oracle.solid import answer
from experiments.solids.trees import Drawn, random_rotation
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.primitives.solid import Solid

EXCUSED = 8
"""Move of a ray, in eps of the lengths of the scene, that excuses another answer."""

SIZE = 1.1
"""Half the edge of the cube, about a solid, that rays go through."""


@dataclasses.dataclass(frozen=True)
class Judged:
    """What was found of some rays, each array one number a ray.

    Attributes:
        hits: Whether the oracle's ray meets the solid.
        differs: Whether ours sees something else: another surface, or none, or one that
            is more than `EXCUSED` eps of the lengths off, across the surface.
        is_wrong: Whether it still does, by twice that, if the oracle's ray is moved by
            up to `EXCUSED` eps of the lengths.
        is_finite: Whether no number of ours is NaN.
    """

    hits: Bool[np.ndarray, " n"]
    differs: Bool[np.ndarray, " n"]
    is_wrong: Bool[np.ndarray, " n"]
    is_finite: Bool[np.ndarray, " n"]


@jax.jit
def _cast(
    solid: Solid, origin: Float[jax.Array, "n 3"], direction: Float[jax.Array, "n 3"]
) -> tuple[Hit, Vec3]:
    ray = Ray(Vec3.from_array(origin), Vec3.from_array(direction))
    hit = solid.intersect(ray)
    return hit, solid.normal(ray, hit)


def rays_at(
    rng: np.random.Generator, distance: float, count: int
) -> tuple[RigidTransform, Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """A random pose so far away, and rays from the origin through what is there."""
    turn = random_rotation(rng)
    shift = np.array([0.0, 0.0, distance])
    target = shift + rng.uniform(-SIZE, SIZE, (count, 3))
    pose = RigidTransform(turn.astype(np.float32), shift.astype(np.float32))
    direction = (target / target[:, 2:]).astype(np.float32)
    return pose, np.zeros_like(direction), direction


def judge(
    drawn: Drawn,
    solid: Solid,
    origin: Float[np.ndarray, "n 3"],
    direction: Float[np.ndarray, "n 3"],
    rng: np.random.Generator,
) -> Judged:
    """Compare a solid with the oracle's.

    Args:
        drawn: The solid as the oracle takes it, in the shapes' frame.
        solid: The same, moved.
        origin: Of the rays, in the world.
        direction: Of the rays.
        rng: Draws the moves.
    """
    hit, normal = _cast(solid, jnp.asarray(origin), jnp.asarray(direction))
    t = np.asarray(hit.t, float)
    turn, shift = (np.asarray(x, float) for x in (solid.rotation, solid.translation))
    o, d = (origin.astype(float) - shift) @ turn, direction.astype(float) @ turn
    speed = np.linalg.norm(d, axis=-1)
    distance = np.linalg.norm(o, axis=-1)

    def differs(
        t: Float[np.ndarray, " m"],
        o: Float[np.ndarray, "m 3"],
        rays: Bool[np.ndarray, " n"] | slice,
        most: float,
    ) -> tuple[Bool[np.ndarray, " m"], Bool[np.ndarray, " m"]]:
        true, _, cosine = answer(drawn.tree, drawn.shapes, o, d[rays])
        both = np.isfinite(t) & np.isfinite(true)
        off = np.abs(np.where(both, t, 0) - np.where(both, true, 0)) * speed[rays]
        reach = distance[rays] + 2 * SIZE + np.where(both, true, 0) * speed[rays]
        is_off = off * cosine > most * eps(np.float32) * reach
        return (np.isfinite(t) != np.isfinite(true)) | is_off, np.isfinite(true)

    different, hits = differs(t, o, slice(None), EXCUSED)
    wrong = different.copy()
    ways = [*np.eye(3), *-np.eye(3), *np.sign(rng.normal(size=(8, 3)))]
    for part in (0.25, 1.0):
        for way in ways:
            rest = np.flatnonzero(wrong)
            if not rest.size:
                break
            step = part * EXCUSED * eps(np.float32) * (distance[rest] + 2 * SIZE)
            moved = o[rest] + step[:, None] * way
            wrong[rest], _ = differs(t[rest], moved, rest, 2 * EXCUSED)
    numbers = np.stack([np.asarray(x) for x in (normal.x, normal.y, normal.z)])
    return Judged(hits, different, wrong, ~np.isnan(t) & ~np.any(np.isnan(numbers), 0))
