"""Triangles of solids made of solids, by manifold3d.

The shapes are joined in their own frame, where flush faces are flush, and the outcome
is moved. What has no end is cut to a box around all that has one: the part of the solid
in the box is right, and a solid that reaches to the box has no end itself.
"""

__all__ = ["solid_surface"]

import itertools
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.io.mesh_sheet import ground_of
from impostor_jax.io.mesh_surface import surface_of
from impostor_jax.io.parts import Tree, tree_of
from impostor_jax.io.triangles import Triangles, moved
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.solid import Solid

ROOM = 0.1
"""Of the box around a solid that is known to have an end, in parts of its size."""

FAR = 8.0
"""The same where only its shapes tell: those that have an end, and points of planes."""

Box = tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]
"""Low and high corner."""


def solid_surface(solid: Solid, tolerance: float) -> Triangles:
    """Triangles of a single solid.

    Args:
        solid: Of any shapes.
        tolerance: Largest distance of each shape's mesh from its surface, in meters.

    Raises:
        ValueError: It has no end, or holds nothing; or manifold3d is not installed.
    """
    try:
        import manifold3d
    except ImportError as error:
        raise ValueError(
            "a mesh of a solid needs manifold3d: pip install 'impostor-jax[mesh]'"
        ) from error
    low, high = box = _box_around(solid)
    whole = manifold3d.Manifold.cube(high - low).translate(low)
    made = _made_of(tree_of(solid), tolerance, whole, box)
    if made.is_empty():
        raise ValueError("a solid must hold something to have a mesh, got an empty one")
    ends = np.asarray(made.bounding_box()).reshape(2, 3)
    few = 1e-9 * np.max(high - low)
    if np.any(ends[0] <= low + few) or np.any(ends[1] >= high - few):
        raise ValueError(
            "a solid must have an end to have a mesh, got one that reaches farther "
            f"than {np.max(high - low):.3g} m"
        )
    mesh = made.to_mesh64()
    pose = RigidTransform(solid.rotation, solid.translation)
    points = moved(np.asarray(mesh.vert_properties, float)[:, :3], pose)
    return Triangles(points, np.asarray(mesh.tri_verts, int))


def _made_of(tree: Tree, tolerance: float, whole: Any, box: Box) -> Any:
    """The manifold of a part of a solid, as far as it lies in a box."""
    from manifold3d import Manifold, OpType

    if isinstance(tree, AbstractPrimitive):
        return _leaf(tree, tolerance, whole, box)
    parts = [_made_of(part, tolerance, whole, box) for part in tree.parts]
    operation = {
        "union": OpType.Add,
        "intersection": OpType.Intersect,
        "difference": OpType.Subtract,
    }[tree.operation]
    return Manifold.batch_boolean(parts, operation)


def _leaf(shape: AbstractPrimitive, tolerance: float, whole: Any, box: Box) -> Any:
    from manifold3d import Error, Manifold, Mesh64

    if isinstance(shape, Plane):
        normal = np.asarray(shape.unit_normal, float)
        normal = normal / np.linalg.norm(normal)
        return whole.trim_by_plane(-normal, -normal @ np.asarray(shape.point, float))
    is_ground = isinstance(shape, Heightfield)
    if is_ground:
        corners = np.array(list(itertools.product(*zip(*box, strict=True))))
        mesh = ground_of(shape, tolerance, corners)
    else:
        mesh = surface_of(shape, tolerance)
    made = Manifold(Mesh64(mesh.vertices, mesh.faces.astype(np.uint64)))
    assert made.status() == Error.NoError, made.status()
    return made ^ whole if is_ground else made


def _box_around(solid: Solid) -> Box:
    """Box in the shapes' frame that holds the solid, if it has an end."""
    own = eqx.tree_at(
        lambda s: (s.rotation, s.translation),
        solid,
        (jnp.eye(3, dtype=solid.dtype), jnp.zeros(3, solid.dtype)),
    )
    if own.hull is not None:
        low, high = own.hull.box()
        return _grown(low, high, ROOM)
    boxes = [
        (shape.point, shape.point) if isinstance(shape, Plane) else shape.hull.box()
        for shape in own.shapes
        if isinstance(shape, Plane) or shape.hull is not None
    ]
    lows, highs = (np.array(ends, float) for ends in zip(*boxes, strict=True))
    return _grown(lows.min(axis=0), highs.max(axis=0), FAR)


def _grown(low: Any, high: Any, room: float) -> Box:
    low, high = np.asarray(low, float), np.asarray(high, float)
    more = room * (np.max(high - low) or 1.0)
    return low - more, high + more
