"""The command `impostor-jax find`."""

__all__ = ["FindCommand"]

import dataclasses
import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from impostor_jax.cli.dials import Dials, EffortName, chosen_effort
from impostor_jax.cli.ending import stream_beside
from impostor_jax.cli.given import camera_of, chosen_noise, hints_on_stderr, priors_of
from impostor_jax.cli.inputs import (
    check_cloud,
    check_images,
    check_noise,
    check_page,
    check_single_image,
)
from impostor_jax.cli.many import Many, check_given, is_one, run_on_many
from impostor_jax.io.atomic import check_output_file, check_output_folder

if TYPE_CHECKING:
    from impostor_jax.many.items import AbstractItem
    from impostor_jax.many.tasks import FindTask

RECORD, PICTURES, LABELS = "found.json", ("labels.png", "overlay.png"), "labels.npy"
"""What it writes: of an image the first two, of a cloud the first and the last."""


@dataclasses.dataclass(frozen=True)
class FindCommand:
    """Find every cylinder in depth images, without masks; or in clouds of points.

    Of a depth image, which needs --camera, it writes found.json, labels.png (16 bit: 0
    for none, k for the k-th cylinder of found.json) and overlay.png. With --page, a
    page for a browser, too, on which readings and cylinders are turned with the mouse.
    Of a cloud it writes found.json and labels.npy: the number for each point of the
    file, but for those that are not finite. The exit code is 0 if a cylinder was found,
    1 if none was and 2 if the input is bad.

    Of several each has a folder of its name, and a table tells of all; one that is
    broken is a row of it, and then the exit code is 1.
    """

    depth: tyro.conf.Positional[tuple[Path, ...]]
    """Depth images: 16-bit PNG, or meters as floating-point TIFF or NPY; folders of
    them, lists of them in .txt files, patterns in quotes, as 'frames/*.png'; or
    datasets of impostor-synth, BOP, TUM RGB-D, ScanNet or Redwood. Without a camera
    clouds of points, too: PLY, PCD, LAS, LAZ, NPY or text."""
    camera: Path | None = None
    """Camera file (JSON): fx, fy, cx, cy, width, height, depth_scale_m, distortion. Of
    several images it may be a pattern, as '{folder}/camera.json' or
    'cameras/{name}.json'; most datasets have their own."""
    origin: tuple[float, float, float] | None = None
    """Where the sensor stood, of clouds whose file does not say it, in meters."""
    sigma: float | None = None
    """Standard deviation of a depth reading, in meters. If neither this nor a sensor is
    given, it is measured in the image."""
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
    effort: EffortName = "balanced"
    """How much work it takes; each dial may be set apart from it."""
    dials: Dials = dataclasses.field(default_factory=Dials)

    many: Many = dataclasses.field(default_factory=Many)

    def run(self) -> int:
        """Run the command; returns the exit code."""
        check_given(self.depth, self.camera, self.origin)
        self.many.check()
        check_noise(self.sigma, self.sensor)
        if is_one(self.depth, self.camera) and not self.many.is_asked:
            return self._run_on_one(self.depth[0])
        if self.json is not None:
            raise ValueError(
                "--json must not be given with several images, or a table of one: each "
                "has a found.json of its own"
            )
        check_single_image(self.page, is_single=False)
        # This starts JAX.
        from impostor_jax.many.inputs import items_of

        items = items_of(self.depth, self.camera)
        return run_on_many(items, self._task(items[0]), self.output, self.many)

    def _run_on_one(self, path: Path) -> int:
        """Search a single image or cloud."""
        if self.camera is None:
            of_images = {"--page": self.page, "--sensor": self.sensor}
            check_cloud(path, "search", of_images)
        else:
            check_images(self.camera, [path], {})
        files = (RECORD, LABELS) if self.camera is None else (RECORD, *PICTURES)
        check_output_folder(self.output, files)
        if self.json is not None:
            check_output_file(self.json, "json")
        check_page(self.page)
        # This starts JAX.
        from impostor_jax.many.inputs import items_of

        (item,) = items_of([path], self.camera)
        task, shown = self._task(item), item.read()
        with hints_on_stderr():
            found, seconds = task.found_in(shown)
        # Lines for a reader go elsewhere if a file is printed.
        print(found, file=stream_beside(self.json, self.page))
        if self.page is not None:
            from impostor_jax.page.fit_page import view

            view(found, shown.depth, shown.camera).save(self.page)
        task.write(found, shown, seconds, self.output, self.json)
        return 0 if found else 1

    def _task(self, item: "AbstractItem") -> "FindTask":
        """What is done on images or on clouds, of which this is the first."""
        from impostor_jax.many.items import CloudFile
        from impostor_jax.many.tasks import FindTask

        is_cloud = isinstance(item, CloudFile)
        arc = self.min_arc_deg
        asked = {
            "prior": priors_of(self.prior_radius, self.prior_height) or None,
            "min_points" if is_cloud else "min_pixels": self.min_pixels,
            "min_arc": None if arc is None else math.radians(arc),
            "radius_range": self.radius_range,
            "origin": self.origin,
        }
        given = {name: value for name, value in asked.items() if value is not None}
        return FindTask(
            given
            | {
                "sigma": chosen_noise(
                    self.sigma, self.sensor, partial(camera_of, item)
                ),
                "effort": chosen_effort(self.effort, self.dials),
            }
        )
