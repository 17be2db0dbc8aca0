"""The command `impostor-jax export`."""

__all__ = ["ExportCommand"]

import dataclasses
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from impostor_jax.io.atomic import check_output_file
from impostor_jax.io.json_file import read_json_object
from impostor_jax.io.mesh_format import check_mesh_file
from impostor_jax.io.scene_record import check_scene_record
from impostor_jax.plain_arguments import plain_number

if TYPE_CHECKING:
    from impostor_jax.primitives.base import AbstractPrimitive


@dataclasses.dataclass(frozen=True)
class ExportCommand:
    """Write the shapes of a scene file, or of a fit, as a triangle mesh.

    The format is told by the ending: PLY, STL, OBJ or GLB. Solids are closed meshes;
    several shapes are one mesh, and are not united.
    """

    shapes: tyro.conf.Positional[Path]
    """Scene file (JSON), or the fit.json of a fit."""
    output: Path
    """File that the mesh is written to: .ply, .stl, .obj or .glb."""
    tolerance: float = 1e-4
    """Largest distance of the mesh from the surfaces of the shapes, in meters."""
    scale: float = 1.0
    """Meters in a unit of the file: 0.001 for one in millimeters."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        check_mesh_file(self.output)
        check_output_file(self.output)
        plain_number("scale", self.scale, positive=True)
        plain_number("tolerance", self.tolerance, positive=True, unit="meters")
        what = f"scene file {str(self.shapes)!r}"
        shapes = self._shapes_of(read_json_object(self.shapes, what), what)
        # This starts JAX, as the shapes do.
        from impostor_jax.io.mesh_export import to_mesh, write_mesh

        mesh = to_mesh(shapes, self.tolerance)
        write_mesh(self.output, mesh, self.scale)
        count = sum(math.prod(shape.batch_shape) for shape in shapes)
        print(f"{self.output}: {len(mesh.faces)} triangles of {count} shapes")
        return 0

    def _shapes_of(
        self, record: dict[str, Any], what: str
    ) -> "list[AbstractPrimitive]":
        """What the file holds: a fit has one shape, and no list of them."""
        is_fit = "shape" in record and "shapes" not in record
        if not is_fit:
            check_scene_record(record, what)
        # These start JAX.
        from impostor_jax.io.record import shape_of_fit
        from impostor_jax.io.scene_file import scene_from_record

        if is_fit:
            return [shape_of_fit(record, f"fit {str(self.shapes)!r}")]
        return scene_from_record(record, what, self.shapes.parent).shapes
