"""The command `impostor-jax render`."""

__all__ = ["RenderCommand"]

import dataclasses
from pathlib import Path

import tyro

from impostor_jax.cli.dials import Dials, EffortName, chosen_effort

FILES = (
    "depth.png", "depth.tiff", "normal.png", "mask.png", "index.png", "camera.json",
)  # fmt: skip
"""What it writes."""


@dataclasses.dataclass(frozen=True)
class RenderCommand:
    """Render a capped cylinder, or the shapes of a scene file.

    Writes depth.png (16 bit), depth.tiff, normal.png, mask.png, index.png (which shape
    is seen: 0 for none, then from 1) and camera.json; `fit` reads them.
    """

    output: Path
    """Folder that the files are written to."""
    scene: tyro.conf.Positional[Path | None] = None
    """Scene file (JSON); in place of center, axis, radius and height."""
    camera: Path | None = None
    """Camera file (JSON): fx, fy, cx, cy, width, height, depth_scale_m, distortion.
    Needed where the scene file holds none."""
    center: tuple[float, float, float] | None = None
    """Midpoint of the axis in the camera frame (x right, y down, z forward), meters."""
    axis: tuple[float, float, float] | None = None
    """Direction of the axis, of any length."""
    radius: float | None = None
    """Radius in meters."""
    height: float | None = None
    """Length from cap to cap in meters."""
    effort: EffortName = "balanced"
    """How much work it takes; each dial may be set apart from it."""
    dials: Dials = dataclasses.field(default_factory=Dials)

    def run(self) -> int:
        """Run the command; returns the exit code."""
        import numpy as np

        from impostor_jax.io import depth_image
        from impostor_jax.io.atomic import check_output_folder
        from impostor_jax.io.camera_file import read_camera, write_camera
        from impostor_jax.rendering.render import render
        from impostor_jax.rendering.scene import Scene

        effort = chosen_effort(self.effort, self.dials)
        shapes, camera = self._shapes()
        given_scale = None
        if self.camera is not None:
            camera, given_scale = read_camera(self.camera)
        if camera is None:
            raise ValueError(
                "camera must be given: a camera file, or in the scene file"
            )
        check_output_folder(self.output, FILES)
        outputs = ("depth", "normal", "mask", "index")
        seen = Scene(shapes) if len(shapes) > 1 else shapes[0]
        maps = render(seen, camera, outputs, effort=effort)
        if effort.stride > 1:
            # Of a lens the rays are solved for anew, which takes its time.
            camera = camera.strided(effort.stride)
        scale = depth_image.fitting_scale(maps.depth, given_scale)
        depth_image.write_depth_png(self.output / "depth.png", maps.depth, scale)
        depth_image.write_depth_tiff(self.output / "depth.tiff", maps.depth)
        depth_image.write_normals(self.output / "normal.png", maps.normal)
        depth_image.write_mask(self.output / "mask.png", maps.mask)
        depth_image.write_index(self.output / "index.png", maps.index)
        write_camera(self.output / "camera.json", camera, scale)
        count = np.count_nonzero(np.asarray(maps.mask))
        seen = len(np.unique(np.asarray(maps.index)[np.asarray(maps.mask)]))
        shown = (
            "the cylinder" if self.scene is None else f"{seen} of {len(shapes)} shapes"
        )
        print(f"{count} of {camera.width * camera.height} pixels see {shown}")
        return 0

    def _shapes(self):
        """Shapes, and the scene file's camera."""
        from impostor_jax.io.scene_file import read_scene
        from impostor_jax.primitives.cylinder import Cylinder

        fields = {
            name: getattr(self, name) for name in ("center", "axis", "radius", "height")
        }
        given = [name for name, value in fields.items() if value is not None]
        if self.scene is not None:
            if given:
                raise ValueError(
                    "a scene file must not be given together with "
                    f"--{', --'.join(given)}"
                )
            return read_scene(self.scene)
        if len(given) < len(fields):
            missing = [f"--{name}" for name in fields if name not in given]
            raise ValueError(f"a scene file or {', '.join(missing)} must be given")
        return [Cylinder(**fields)], None
