"""What a shader is told of solids made of others: of all their shapes, one by one."""

__all__ = ["solid_impostor"]

import functools
import hashlib
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.glsl.impostor import Ball, Impostor, Leaf, Structure, hull_ball
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.expression import Expression
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.solid import Solid
from impostor_jax.primitives.torus import Torus

FIELDS = {
    "center": 3,
    "rotation": 9,
    "size": 3,
    "translation": 3,
    "middle": 3,
    "radius": 1,
    "farthest": 1,
}

ENDLESS = 1e30
"""Size of the box around what has no end."""


def solid_impostor(solid: Solid, impostors: tuple[Impostor, ...]) -> Impostor:
    """How a solid is drawn; the same for all of one structure.

    Args:
        solid: A single one or a batch.
        impostors: How its shapes would be drawn.
    """
    pairs = zip(solid.shapes, impostors, strict=True)
    leaves = tuple(
        Leaf(impostor, shape.num_parts, _num_stretches(shape))
        for shape, impostor in pairs
    )
    return _impostor(solid.expression, leaves)


@functools.cache
def _impostor(expression: Expression, leaves: tuple[Leaf, ...]) -> Impostor:
    structure = Structure(expression, leaves)
    told = [(leaf.impostor.name, leaf.num_parts, leaf.num_stretches) for leaf in leaves]
    mark = hashlib.sha256(repr((expression, told)).encode()).hexdigest()[:12]
    has_samples = any(leaf.impostor.samples for leaf in leaves)
    return Impostor(
        f"solid_{mark}",
        FIELDS,
        _values,
        functools.partial(_samples, structure) if has_samples else None,
        functools.partial(_numbers, structure),
        billboard="box",
        ball=functools.partial(_ball, structure),
        structure=structure,
    )


def _num_stretches(shape: AbstractPrimitive) -> int:
    """How many stretches a ray has in it at most."""
    is_sector = isinstance(shape, Cylinder | Frustum) and shape.start_angle is not None
    return 2 if is_sector or isinstance(shape, Torus | Heightfield) else 1


def _values(solids: Solid) -> dict[str, Any]:
    """The box that is seen, the pose, and the ball in the frame of the shapes."""
    solids = jax.tree.map(jnp.asarray, solids)
    rotation, translation = solids.rotation, solids.translation
    still = jnp.broadcast_to(jnp.eye(3), rotation.shape), jnp.zeros_like(translation)
    held = eqx.tree_at(lambda s: (s.rotation, s.translation), solids, still).hull
    if held is None:
        low, high = (jnp.full_like(translation, end / 2) for end in (-ENDLESS, ENDLESS))
    else:
        low, high = held.box()
    # Grids know where they are.
    ball, reach = solids.extent
    assert ball is not None
    middle, radius = ball
    center = jnp.einsum("nij,nj->ni", rotation, (low + high) / 2) + translation
    return {
        "center": center,
        "rotation": rotation,
        "size": high - low,
        "translation": translation,
        "middle": middle,
        "radius": jnp.broadcast_to(radius, solids.batch_shape),
        "farthest": reach,
    }


def _numbers(structure: Structure, solids: Solid) -> Float[np.ndarray, "n k 4"]:
    """Fields of the leaves; and where a leaf's samples begin among the solid's."""
    rows, first_sample, (many,) = [], 0, solids.batch_shape
    for leaf, shape in zip(structure.leaves, solids.shapes, strict=True):
        row = leaf.impostor.columns(shape)
        if leaf.impostor.samples:
            row = np.concatenate([row, np.full((many, 1), first_sample)], axis=-1)
            first_sample += leaf.impostor.samples(shape).shape[1]
        spare = 4 * leaf.impostor.texels - row.shape[1]
        rows.append(np.pad(row, ((0, 0), (0, spare))))
    return np.concatenate(rows, axis=-1).reshape(many, -1, 4)


def _samples(structure: Structure, solids: Solid) -> Float[np.ndarray, "n k"]:
    """Those of the leaves, one after the other."""
    found = [
        leaf.impostor.samples(shape)
        for leaf, shape in zip(structure.leaves, solids.shapes, strict=True)
        if leaf.impostor.samples
    ]
    return np.concatenate(found, axis=-1)


def _ball(structure: Structure, solids: Solid) -> Ball:
    """Around the hull, or else around each of the shapes, where they are seen."""
    if solids.is_bounded:
        return hull_ball(solids)
    moved = jax.vmap(
        lambda shapes, *pose: tuple(
            s.transformed(RigidTransform(*pose)) for s in shapes
        )
    )(*jax.tree.map(jnp.asarray, (solids.shapes, solids.rotation, solids.translation)))
    pairs = zip(structure.leaves, jax.tree.map(np.asarray, moved), strict=True)
    center, radius = zip(*(leaf.impostor.ball(s) for leaf, s in pairs), strict=True)
    return np.concatenate(center), np.concatenate(radius)
