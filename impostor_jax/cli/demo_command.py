"""The command `impostor-jax demo`."""

__all__ = ["DemoCommand"]

import dataclasses
import time
from pathlib import Path
from typing import TYPE_CHECKING

from impostor_jax.io.atomic import check_output_folder, write_json

if TYPE_CHECKING:
    from impostor_jax.fit.result import Fit
    from impostor_jax.primitives.cylinder import Cylinder

SIGMA = 0.001
WALL_DEPTH = 1.2
FILES = ("depth.png", "camera.json", "fit.json", "overlay.png")


@dataclasses.dataclass(frozen=True)
class DemoCommand:
    """Render a noisy can in front of a wall, fit it and compare.

    Writes depth.png, camera.json, fit.json and overlay.png; then
    `impostor-jax fit depth.png --camera camera.json` fits the same image again.
    """

    output: Path = Path("impostor_demo")
    """Folder that the files are written to."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        import jax
        import jax.numpy as jnp
        import numpy as np

        from impostor_jax.camera.pinhole import PinholeCamera
        from impostor_jax.fits.single import fit_cylinder
        from impostor_jax.io.camera_file import write_camera
        from impostor_jax.io.depth_image import fitting_scale, write_depth_png
        from impostor_jax.primitives.cylinder import Cylinder
        from impostor_jax.rendering.render import render
        from impostor_jax.sensor.gaussian import ConstantNoise
        from impostor_jax.viewer.figure import write_overlay

        check_output_folder(self.output, FILES)
        camera = PinholeCamera(525.0, 525.0, 319.5, 239.5, width=640, height=480)
        can = Cylinder((0.02, 0.01, 0.8), (0.3, 0.8, 0.52), radius=0.04, height=0.12)
        maps = render(can, camera)
        assert maps.depth is not None
        assert maps.normal is not None
        scene = jnp.minimum(maps.depth, WALL_DEPTH)
        depth = np.asarray(
            ConstantNoise(SIGMA).sample(jax.random.key(0), scene, maps.normal, camera)
        )
        start = time.perf_counter()
        fit = fit_cylinder(depth, camera, sigma=SIGMA)
        fit.rms.block_until_ready()
        seconds = time.perf_counter() - start
        print(
            f"a can in front of a wall, depth noise {1e3 * SIGMA:g} mm, no mask given\n"
            f"{fit.summary(seconds).splitlines()[0]}\n{_table(can, fit)}"
        )
        scale = fitting_scale(depth, None)
        write_depth_png(self.output / "depth.png", depth, scale)
        write_camera(self.output / "camera.json", camera, scale)
        write_json(self.output / "fit.json", fit.to_dict(seconds))
        write_overlay(self.output / "overlay.png", fit, depth, camera)
        print(f"pictures and files: {self.output}")
        return 0 if bool(fit.success) else 1


def _table(truth: "Cylinder", fit: "Fit") -> str:
    """True value, fitted value and standard deviation of each parameter."""
    import numpy as np

    std, fitted = fit.std, fit.cylinder
    # By the sine: in single precision the cosine of a small angle is 1.
    first, second = (np.asarray(c.axis, dtype=float) for c in (truth, fitted))
    sine = np.linalg.norm(np.cross(first, second))
    lines = [f"{'':12}{'true':>10}{'fitted':>10}{'std':>10}"]
    for name in ("center x", "center y", "center z", "radius", "height"):
        field, _, letter = name.partition(" ")
        values = [getattr(one, field) for one in (truth, fitted, std)]
        values = [value["xyz".index(letter)] if letter else value for value in values]
        cells = "".join(f"{1e3 * float(value):>10.3f}" for value in values)
        lines.append(f"{name:<12}{cells} mm")
    angle = np.degrees(np.arcsin(min(1.0, sine)))
    spread = np.degrees(np.linalg.norm(std.axis))
    lines.append(f"{'axis, off by':<12}{0:>10.3f}{angle:>10.3f}{spread:>10.3f} degrees")
    return "\n".join(lines)
