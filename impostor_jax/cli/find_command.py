"""The command `impostor-jax find`."""

__all__ = ["FindCommand"]

import dataclasses
import math
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from impostor_jax.cli.dials import Dials, EffortName, chosen_effort
from impostor_jax.cli.found_before import count_there, digest_of
from impostor_jax.cli.given import (
    chosen_noise,
    hints_on_stderr,
    images_of,
    places_of,
    priors_of,
)
from impostor_jax.cli.inputs import (
    check_images,
    check_noise,
    check_page,
    check_single_image,
)

if TYPE_CHECKING:
    from impostor_jax.camera.base import AbstractCamera
    from impostor_jax.io.camera_file import CameraFile

RECORD, PICTURES = "found.json", ("labels.png", "overlay.png")
"""What it writes."""


@dataclasses.dataclass(frozen=True)
class FindCommand:
    """Find every cylinder in depth images, without masks; or in clouds of points.

    Of depth images, which need --camera, it writes found.json, labels.png (16 bit: 0
    for none, k for the k-th cylinder of found.json) and overlay.png; of several images
    each into a folder of its name. With --page, a page for a browser, too, on which
    readings and cylinders are turned with the mouse. Of clouds it writes found.json and
    labels.npy: the number for each point of the file, but for those that are not
    finite. The exit code is 0 if a cylinder was found, 1 if none was and 2 if the input
    is bad.
    """

    depth: tyro.conf.Positional[tuple[Path, ...]]
    """Depth images: 16-bit PNG, or meters as floating-point TIFF or NPY; or folders of
    them, or patterns in quotes, as 'frames/*.png'. Without a camera, clouds of points:
    PLY, PCD, LAS, LAZ, NPY or text."""
    camera: Path | None = None
    """Camera file (JSON): fx, fy, cx, cy, width, height, depth_scale_m, distortion."""
    origin: tuple[float, float, float] | None = None
    """Where the sensor stood, of clouds whose file does not say it, in meters."""
    sigma: float | None = None
    """Standard deviation of a depth reading, in meters; 0.001 if neither this nor a
    sensor is given."""
    sensor: str | None = None
    """Model of the sensor: a whole camera (structured_light_camera, stereo_camera or
    time_of_flight_camera), its noise alone (the same without _camera), or a JSON file
    with a type and its numbers, as calibrate writes it."""
    prior_radius: tuple[float, float] | None = None
    """Expected radius and its standard deviation, in meters."""
    prior_height: tuple[float, float] | None = None
    """Expected height and its standard deviation, in meters."""
    min_pixels: int | None = None
    """Fewest pixels of a cylinder, as in `find_cylinders`, like the next two; of clouds
    fewest points."""
    min_arc_deg: float | None = None
    """Smallest angle about the axis over which the wall is seen."""
    radius_range: tuple[float, float] | None = None
    """Smallest and largest radius, in meters."""
    output: Path = Path(".")
    """Folder that the files are written to."""
    json: Path | None = None
    """File for the record of a single image, instead of found.json in the output
    folder; "-" is the standard output."""
    page: Path | None = None
    """HTML file on which what was found in a single image is looked at, in a browser
    with WebGL2: readings by their residuals, cylinders, intervals and numbers."""
    resume: bool = False
    """Leave images as they are whose files are there, made from the same image with the
    same options: the rest of an interrupted run."""
    effort: EffortName = "balanced"
    """How much work it takes; each dial may be set apart from it."""
    dials: Dials = dataclasses.field(default_factory=Dials)

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from tqdm import tqdm

        from impostor_jax.cli.ending import stream_beside
        from impostor_jax.cli.in_turn import found_in_turn
        from impostor_jax.io.atomic import check_output_file, check_output_folder

        if self.camera is None:
            return self._run_on_clouds()
        if self.origin is not None:
            raise ValueError("--origin must be given with clouds alone, not --camera")
        images = images_of(self.depth)
        places = places_of(images, self.output)
        several = len(images) > 1
        if self.json is not None and several:
            raise ValueError(
                "--json must not be given with several images: each has a found.json "
                "of its own"
            )
        check_single_image(self.page, not several)
        check_noise(self.sigma, self.sensor)
        check_images(self.camera, images, {})
        # This starts JAX.
        from impostor_jax.io.camera_file import CameraFile, read_camera

        camera, depth_scale_m = read_camera(self.camera)
        file = CameraFile(camera, depth_scale_m)
        asked = self._asked(camera)
        for place in places:
            check_output_folder(place, (RECORD, *PICTURES))
        if self.json is not None:
            check_output_file(self.json, "json")
        check_page(self.page)
        # Lines for a reader go elsewhere if a file is printed; around the bar.
        tell = partial(tqdm.write, file=stream_beside(self.json, self.page))

        def search(image: Path, place: Path) -> int:
            return self._found(image, place, file, asked, tell)

        return found_in_turn(images, places, "image", tell, search)

    def _run_on_clouds(self) -> int:
        """The same without a camera."""
        from impostor_jax.cli.find_points import check_clouds, find_in_clouds

        check_clouds(self.depth, self.json, self.page, self.sensor)
        check_noise(self.sigma, None)
        asked = self._asked(None, "min_points") | {"origin": self.origin}
        return find_in_clouds(self.depth, self.output, self.json, self.resume, asked)

    def _asked(
        self, camera: "AbstractCamera | None", fewest: str = "min_pixels"
    ) -> dict[str, Any]:
        """What a search takes by name.

        Args:
            camera: Of the images; None of clouds.
            fewest: How the search calls the fewest pixels.
        """
        arc = self.min_arc_deg
        asked = {
            "prior": priors_of(self.prior_radius, self.prior_height) or None,
            fewest: self.min_pixels,
            "min_arc": None if arc is None else math.radians(arc),
            "radius_range": self.radius_range,
        }
        given = {name: value for name, value in asked.items() if value is not None}
        return given | {
            "sigma": chosen_noise(self.sigma, self.sensor, camera),
            "effort": chosen_effort(self.effort, self.dials),
        }

    def _found(
        self,
        image: Path,
        place: Path,
        file: "CameraFile",
        asked: dict[str, Any],
        tell: Any,
    ) -> int:
        """Search one image and write its files, the record last; how many were found.

        Args:
            image: Of the depth.
            place: Folder of what is written.
            file: What the camera file holds.
            asked: As of `_asked`.
            tell: Prints a line for a reader.
        """
        from impostor_jax.find.cylinders import find_cylinders
        from impostor_jax.io.atomic import write_json
        from impostor_jax.io.depth_image import read_depth, write_index
        from impostor_jax.io.record import found_record
        from impostor_jax.viewer.figure import write_overlay

        camera, depth_scale_m = file
        depth = read_depth(image, depth_scale_m, (camera.height, camera.width))
        record = self.json or place / RECORD
        made_from = _made_from(image, file, asked)
        files = [place / name for name in PICTURES]
        # A page that is there may be of another run: nothing on it tells.
        if (
            self.resume
            and self.page is None
            and (count := count_there(record, files, made_from)) is not None
        ):
            tell(f"{count} found before")
            return count
        start = time.perf_counter()
        with hints_on_stderr():
            found = find_cylinders(depth, camera, **asked)
        seconds = time.perf_counter() - start
        tell(str(found))
        write_index(place / PICTURES[0], found.labels - 1)
        write_overlay(place / PICTURES[1], found, depth, camera)
        if self.page is not None:
            from impostor_jax.page.fit_page import view

            view(found, depth, camera).save(self.page)
        write_json(record, found_record(found, camera, seconds, made_from))
        return len(found)


def _made_from(
    image: Path, file: "CameraFile", asked: dict[str, Any]
) -> dict[str, Any]:
    """What the files of an image depend on, for its record."""
    from impostor_jax.io.camera_file import camera_record
    from impostor_jax.io.sensor_record import sensor_record
    from impostor_jax.sensor.base import AbstractDepthNoise

    sigma = asked["sigma"]
    is_model = isinstance(sigma, AbstractDepthNoise)
    return {
        "depth": image.name,
        "sha256": digest_of(image),
        "camera": camera_record(*file),
        **asked,
        "sigma": sensor_record(sigma) if is_model else sigma,
        "effort": dataclasses.asdict(asked["effort"]),
    }
