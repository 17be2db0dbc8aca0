"""The command `impostor-jax calibrate`."""

__all__ = ["CalibrateCommand"]

import dataclasses
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from impostor_jax.cli.ending import stream_beside
from impostor_jax.cli.given import files_of, hints_on_stderr, images_of
from impostor_jax.cli.inputs import check_images
from impostor_jax.io.atomic import check_output_file, write_json

if TYPE_CHECKING:
    import numpy as np


@dataclasses.dataclass(frozen=True)
class CalibrateCommand:
    """Measure a sensor's noise on images of planes: walls, tables, floors.

    Writes sensor.json, which --sensor of fit, find and impostor-synth generate takes:
    the noise of single readings, smooth errors of few and of many pixels and, from a
    cylinder of known radius, the error of the scale. The exit code is 0, or 2 if the
    input is bad.
    """

    depth: tyro.conf.Positional[tuple[Path, ...]]
    """Depth images: 16-bit PNG, or meters as floating-point TIFF or NPY; or folders of
    them, or patterns in quotes, as 'frames/*.png'."""
    camera: Path
    """Camera file (JSON): fx, fy, cx, cy, width, height, depth_scale_m, distortion."""
    masks: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """Mask image of the pixels that may be used; all if none is given. Of several depth
    images once for each, or a folder of PNG files of their names."""
    objects: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """Mask image of the wall of a cylinder of known radius, given as masks are."""
    radius: float | None = None
    """Radius of that cylinder, in meters."""
    kind: Literal["structured_light", "stereo", "time_of_flight", "constant"] = (
        "structured_light"
    )
    """What the sensor is."""
    half_window: float = 4.3
    """Reach of its matching window, in pixels of the sensor, of the first two kinds."""
    native_scale: float = 1.0
    """Pixels of the image for one of the sensor's: over 1 where it was enlarged."""
    baseline: float = 0.05
    """Of a stereo camera, in meters."""
    output: Path = Path("sensor.json")
    """File that is written; "-" is the standard output."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        images = images_of(self.depth)
        if not images:
            raise ValueError("a depth image must be given, got none")
        masks = files_of("--masks", self.masks, images)
        objects = files_of("--objects", self.objects, images)
        if bool(objects) != (self.radius is not None):
            raise ValueError("--objects and --radius must be given together")
        check_images(self.camera, images, {"mask": [*masks, *objects]})
        check_output_file(self.output)
        # These start JAX.
        import numpy as np

        from impostor_jax.calibrate.calibration import calibration_of
        from impostor_jax.io.camera_file import read_camera
        from impostor_jax.io.depth_image import read_depth
        from impostor_jax.io.sensor_record import sensor_record

        camera, depth_scale_m = read_camera(self.camera)
        size = camera.height, camera.width
        depths = np.stack([read_depth(image, depth_scale_m, size) for image in images])
        with hints_on_stderr():
            found = calibration_of(
                depths,
                camera,
                _stacked(masks, size),
                kind=self.kind,
                objects=_stacked(objects, size),
                radius=self.radius,
                half_window=self.half_window,
                native_scale=self.native_scale,
                baseline=self.baseline,
            )
        # Lines for a reader go elsewhere if the record is printed.
        tell = partial(print, file=stream_beside(self.output))
        tell(found.summary())
        write_json(self.output, sensor_record(found.sensor))
        return 0


def _stacked(paths: list[Path], size: tuple[int, int]) -> "np.ndarray | None":
    """Masks of all images; None where there are no files."""
    import numpy as np

    from impostor_jax.io.depth_image import read_mask

    return np.stack([read_mask(path, size) for path in paths]) if paths else None
