"""Triangle meshes of shapes and solids, for programs that know nothing else."""

__all__ = ["FORMATS", "check_mesh_file", "to_mesh", "write_mesh"]

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from impostor_jax.arguments import is_concrete, real_number
from impostor_jax.io.atomic import write_atomically
from impostor_jax.io.mesh_format import FORMATS, check_mesh_file
from impostor_jax.io.mesh_solid import solid_surface
from impostor_jax.io.mesh_surface import surface_of
from impostor_jax.io.parts import members
from impostor_jax.io.triangles import Triangles
from impostor_jax.primitives.base import AbstractPrimitive, not_a_shape
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.solid import Solid
from impostor_jax.primitives.triangle import Triangle

if TYPE_CHECKING:
    import trimesh


def to_mesh(
    shape: AbstractPrimitive | Sequence[AbstractPrimitive], tolerance: Any
) -> "trimesh.Trimesh":
    """Make a triangle mesh of shapes, in the world frame and in meters.

    Args:
        shape: A primitive or a solid, a single one or a batch; or a sequence of them.
            Several are one mesh, in order, as files hold one and as a batch of
            triangles is one: those that overlap are not united, which `union` does.
        tolerance: Largest distance of the mesh from the surface, and of the surface
            from the mesh, in meters; corners lie on the surface to rounding. Of a
            solid, it is that from the surfaces of the shapes that it is made of, and
            an edge where two of them cross at the angle alpha may be off by the
            tolerance over sin(alpha): `Solid.implicit` is nowhere on the mesh farther
            from 0 than the tolerance. What is thinner than that may have holes.

    Returns:
        Closed where the shape is, with the normals outward. A heightfield is an open
        sheet with the normals up; in a solid it is the ground below it.

    Raises:
        ValueError: A plane, or a solid, has no end; a solid is empty; the triangles
            would be too many; something is no shape, or traced; or trimesh or
            manifold3d is not installed.
    """
    try:
        import trimesh
    except ImportError as error:
        raise ValueError(
            "a mesh needs trimesh: pip install 'impostor-jax[mesh]'"
        ) from error
    tolerance = real_number("tolerance", tolerance, positive=True, unit="meters")
    shapes = [shape] if isinstance(shape, AbstractPrimitive) else shape
    if not isinstance(shapes, Sequence) or not shapes:
        raise ValueError(
            f"shape must be a primitive, or a sequence of them, got {shape!r}"
        )
    for one in shapes:
        if not isinstance(one, AbstractPrimitive):
            raise ValueError(f"shape must be a primitive, got {not_a_shape(one)}")
    if not is_concrete(shapes):
        raise ValueError("shape must have numbers to be a mesh, got a traced one")
    meshes = [mesh for one in shapes for mesh in _meshes_of(one, tolerance)]
    vertices, faces = zip(*meshes, strict=True)
    joined = trimesh.util.append_faces(vertices, faces)
    return trimesh.Trimesh(*joined, process=False)


def _meshes_of(shape: AbstractPrimitive, tolerance: float) -> list[Triangles]:
    """A mesh of each member of a batch; of triangles together."""
    if isinstance(shape, Plane):
        raise ValueError(
            "a plane must be cut by a solid to have a mesh: it has no end by itself"
        )
    if isinstance(shape, Triangle):
        return [surface_of(shape, tolerance)]
    return [
        solid_surface(one, tolerance)
        if isinstance(one, Solid)
        else surface_of(one, tolerance)
        for one in members(shape, shape.batch_shape)
    ]


def write_mesh(path: Path, mesh: "trimesh.Trimesh", scale: Any = 1.0) -> None:
    """Write a mesh as PLY, STL, OBJ or GLB, told by the ending.

    Args:
        path: File name.
        mesh: In meters. PLY, STL and GLB hold single precision: subtract an offset
            from what lies far off.
        scale: Meters in a unit of the file, as `read_mesh` has it: 0.001 of one in
            millimeters.

    Raises:
        ValueError: The ending is of no such format.
    """
    check_mesh_file(path, "path")
    scale = real_number("scale", scale, positive=True)
    scaled = mesh.copy()
    scaled.apply_scale(1 / scale)
    data: Any = scaled.export(file_type=path.suffix.lower().lstrip("."))
    data = data.encode() if isinstance(data, str) else data
    write_atomically(path, lambda partial: partial.write_bytes(data))
