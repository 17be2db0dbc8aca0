"""Triangle meshes of any format that trimesh reads: PLY, OBJ, STL, GLB and others."""

__all__ = ["read_mesh"]

from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from impostor_jax.arguments import place_of, real_number
from impostor_jax.io.input_file import require_file
from impostor_jax.primitives.triangle import Triangle, is_thin


def read_mesh(path: str | Path, scale: Any = 1.0) -> Triangle:
    """Read the triangles of a mesh file.

    Args:
        path: A file of a format that trimesh reads, told by its ending. What it places
            several times, or moves, is where it says.
        scale: Meters in a unit of the file: 0.001 of one in millimeters.

    Returns:
        A batch (n,) in the order of the file. Faces of more corners are cut into
        triangles; those that are a line to rounding are left out.

    Raises:
        ValueError: The file is missing, broken, of another format or without triangles,
            or trimesh is not installed.
    """
    path, scale = Path(path), real_number("scale", scale, positive=True)
    what = f"mesh file {str(path)!r}"
    require_file(path, what)
    corners = scale * _corners(path, what)
    dtype = jnp.result_type(float)
    limit = float(np.finfo(dtype).max) ** 0.5
    if not np.all(np.abs(corners) < limit):
        raise ValueError(f"{what} must hold finite corners, of less than {limit:.3g} m")
    corners = np.asarray(place_of(corners, jnp.asarray(corners, dtype)))
    corners = corners[~is_thin(corners, dtype)]
    if not len(corners):
        raise ValueError(f"{what} must hold triangles, got none that spans an area")
    return Triangle(corners)


def _corners(path: Path, what: str) -> Any:
    """Corners of all faces (n, 3, 3), in the file's unit."""
    try:
        import trimesh
        from trimesh.exchange.load import mesh_formats
    except ImportError as error:
        raise ValueError(
            f"{what} needs trimesh: pip install 'impostor-jax[mesh]'"
        ) from error
    if path.suffix.lower().lstrip(".") not in mesh_formats():
        names = ", ".join(f".{name}" for name in sorted(mesh_formats()))
        raise ValueError(f"{what} must end in one of {names}")
    try:
        # Corners that lie together stay as many as they are.
        scene = trimesh.load_scene(path, process=False)
        return np.asarray(scene.to_mesh().triangles, float)
    except Exception as error:  # Its readers raise whatever they meet.
        raise ValueError(f"{what} is not readable: {error}") from error
