"""The command `impostor-jax render`."""

__all__ = ["Render"]

import dataclasses
from pathlib import Path


@dataclasses.dataclass(frozen=True)
class Render:
    """Render a capped cylinder to files that `fit` reads.

    Writes depth.png (16 bit), depth.tiff, normal.png, mask.png and camera.json.
    """

    camera: Path
    """Camera file (JSON): fx, fy, cx, cy, width, height, depth_scale_m, distortion."""
    center: tuple[float, float, float]
    """Midpoint of the axis in the camera frame (x right, y down, z forward), meters."""
    axis: tuple[float, float, float]
    """Direction of the axis, of any length."""
    radius: float
    """Radius in meters."""
    height: float
    """Length from cap to cap in meters."""
    output: Path
    """Folder that the files are written to."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        import numpy as np

        from impostor_jax.io import depth_image
        from impostor_jax.io.camera_file import read_camera, write_camera
        from impostor_jax.primitives.cylinder import Cylinder
        from impostor_jax.rendering.raycast import render

        camera, given_scale = read_camera(self.camera)
        cylinder = Cylinder(self.center, self.axis, self.radius, self.height)
        maps = render(cylinder, camera)
        scale = depth_image.fitting_scale(maps.depth, given_scale)
        depth_image.write_depth_png(self.output / "depth.png", maps.depth, scale)
        depth_image.write_depth_tiff(self.output / "depth.tiff", maps.depth)
        depth_image.write_normals(self.output / "normal.png", maps.normal)
        depth_image.write_mask(self.output / "mask.png", maps.mask)
        write_camera(self.output / "camera.json", camera, scale)
        count = np.count_nonzero(np.asarray(maps.mask))
        print(f"{count} of {camera.width * camera.height} pixels see the cylinder")
        return 0
