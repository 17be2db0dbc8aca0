"""The command `impostor-jax fit`."""

__all__ = ["FitCommand"]

import dataclasses
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from impostor_jax.cli.dials import Dials, EffortName, chosen_effort
from impostor_jax.cli.ending import stream_beside
from impostor_jax.cli.given import (
    camera_of,
    chosen_noise,
    files_of,
    hints_on_stderr,
    priors_of,
    start_of,
)
from impostor_jax.cli.inputs import (
    check_cloud,
    check_images,
    check_noise,
    check_page,
    check_single_image,
)
from impostor_jax.cli.many import Many, check_given, is_one, run_on_many
from impostor_jax.io.atomic import check_output_file, check_output_folder
from impostor_jax.io.scene_record import read_scene_record

if TYPE_CHECKING:
    from impostor_jax.fit.result import Fit
    from impostor_jax.many.items import AbstractItem
    from impostor_jax.many.tasks import FitTask

FILES = ("fit.json", "overlay.png")
"""What it writes of an image."""


@dataclasses.dataclass(frozen=True)
class FitCommand:
    """Fit a capped cylinder, or another shape, to depth images or clouds of points.

    Writes fit.json and overlay.png; of several labels each into a folder label_N. With
    --page, a page for a browser, too, on which readings and shapes are turned with the
    mouse. The exit code is 0 if all fits succeeded, 1 if one failed and 2 if the input
    is bad.

    Of several images each has a folder of its name, and a table tells of all; one that
    is broken is a row of it, and then the exit code is 1.
    """

    depth: tyro.conf.Positional[tuple[Path, ...]]
    """Depth images, folders, lists, datasets or patterns of them, as `find` takes them;
    or, without a camera, clouds of points."""
    camera: Path | None = None
    """Camera file (JSON): fx, fy, cx, cy, width, height, depth_scale_m, distortion. Of
    several images it may be a pattern, as '{folder}/camera.json' or
    'cameras/{name}.json'; most datasets have their own."""
    origin: tuple[float, float, float] | None = None
    """Where the sensor stood, of clouds whose file does not say it, in meters."""
    mask: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """Mask image, not 0 on the object; an object is searched for if none is given. Of
    several depth images once for each, a folder of PNG files of their names, or a
    pattern, as '{folder}/../mask/{name}.png'. Datasets have their own."""
    labels: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """Label image instead of a mask: 0 where there is no object, otherwise its number;
    each object is fitted. Of several depth images as masks are given."""
    shape: Literal["cylinder", "sphere", "frustum", "tube", "box"] = "cylinder"
    """What is fitted."""
    sigma: float | None = None
    """Standard deviation of a depth reading, in meters. If neither this nor a sensor is
    given, it is measured in the image. With --silhouette that of the mask's edge, in
    pixels: 0.5 all along if it is not given, 0 if it is exact."""
    sensor: str | None = None
    """Model of the sensor: a whole camera (structured_light_camera, stereo_camera or
    time_of_flight_camera), its noise alone (the same without _camera), or a JSON file
    with a type and its numbers, as calibrate writes it."""
    prior_radius: tuple[float, float] | None = None
    """Expected radius and its standard deviation, in meters."""
    prior_height: tuple[float, float] | None = None
    """Expected height and its standard deviation, in meters."""
    initial: Path | None = None
    """Scene file with the one shape that the fits begin with."""
    fixed: tuple[str, ...] = ()
    """Names of what keeps its value in that shape: center, axis, radius, height."""
    mask_meaning: Literal["region", "outline"] = "region"
    """Whether the mask is any part of the object or its edge is the silhouette."""
    errors: Literal["independent", "correlated"] | None = None
    """How readings of neighboring pixels err; decides the standard deviations. By
    default correlated if the sensor has a matching window."""
    test_taper: bool = False
    """Whether to test if a frustum, a cup, is needed instead of a cylinder."""
    test_bore: bool = False
    """Whether to test if a tube, a pipe or a mug, is needed instead of a cylinder."""
    silhouette: bool = False
    """Whether the files are masks, or label images, of what has no readings: glass, or
    a mirror. Its outline tells all but the scale; a prior of the radius tells that."""
    views: Path | None = None
    """JSON file that makes the images views of one object, with one fit to all: a list
    of 4 x 4 matrices, from the world to the camera, one for each image."""
    pose_sigma: tuple[float, float] | None = None
    """What these poses are off by: standard deviations of the camera's place, in
    meters, and of its rotation, in radians; 0 0 if they are exact."""
    output: Path = Path(".")
    """Folder that the files are written to."""
    json: Path | None = None
    """File for the record of a single fit, instead of fit.json in the output folder;
    "-" is the standard output."""
    page: Path | None = None
    """HTML file on which the fits of a single image are looked at, in a browser with
    WebGL2: readings by their residuals, shapes, intervals and numbers."""
    effort: EffortName = "balanced"
    """How much work it takes; each dial may be set apart from it."""
    dials: Dials = dataclasses.field(default_factory=Dials)
    many: Many = dataclasses.field(default_factory=Many)

    def run(self) -> int:
        """Run the command; returns the exit code."""
        check_given(self.depth, self.camera, self.origin)
        self.many.check()
        if self.mask and self.labels:
            raise ValueError("--mask must not be given together with --labels")
        is_single = is_one(self.depth, self.camera) and not self.many.is_asked
        is_single |= self.views is not None
        if self.json is not None and (self.labels or not is_single):
            raise ValueError(
                "--json must not be given with --labels or several images: each fit "
                "has a fit.json of its own"
            )
        check_single_image(self.page, is_single)
        self._check_flags()
        if is_single:
            return self._run_on_one()
        # This starts JAX.
        items = self._items()
        return run_on_many(items, self._task(items[0]), self.output, self.many)

    def _check_flags(self) -> None:
        """Raise where flags, or their files, are seen to be bad without JAX."""
        chosen_effort(self.effort, self.dials)
        check_noise(self.sigma, self.sensor, is_of_edge=self.silhouette)
        if self.initial is not None:
            read_scene_record(self.initial)
        tests = {"--test-taper": self.test_taper, "--test-bore": self.test_bore}
        for name, is_asked in tests.items():
            if is_asked and self.shape != "cylinder":
                raise ValueError(f"{name} must not be given for a {self.shape}")
        for flag, is_given in (
            ("--silhouette", self.silhouette),
            ("--views", self.views),
        ):
            if is_given and (self.camera is None or self.labels):
                raise ValueError(f"{flag} must be given with --camera, not --labels")
        if self.pose_sigma is not None and self.views is None:
            raise ValueError("--pose-sigma must be given with --views")
        if self.silhouette and (self.mask or self.views or self.page):
            raise ValueError(
                "--silhouette must not be given with --mask, --views, --page"
            )

    def _run_on_one(self) -> int:
        """Fit to a single image or cloud."""
        if self.camera is None:
            self._check_cloud()
        elif self.silhouette:
            check_images(self.camera, [], {"mask": self.depth})
        elif self.views is None:
            masks = files_of("--mask", self.mask, self.depth)
            labels = files_of("--labels", self.labels, self.depth)
            beside = {"mask": masks, "label image": labels}
            check_images(self.camera, self.depth, beside)
        check_output_folder(self.output, () if self.labels else FILES)
        if self.json is not None:
            check_output_file(self.json, "json")
        check_page(self.page)
        # These start JAX.
        from impostor_jax.many.items import ImageFile
        from impostor_jax.many.tasks import write_fit

        (item,) = self._items()
        task, shown = self._task(item), item.read()
        # Lines for a reader go elsewhere if the record, or the page, is printed.
        tell = partial(print, file=stream_beside(self.json, self.page))
        with hints_on_stderr():
            fits, seconds = task.fits_of(shown)
            tests = [task.tests_of(fit) for fit in fits.values()]
        named = {}
        for (label, fit), tested in zip(fits.items(), tests, strict=True):
            if label is not None:
                tell(f"label {label}:")
            elif not self.mask and isinstance(item, ImageFile):
                tell(_region_taken(fit))
            tell(fit.summary(seconds))
            for test in filter(None, tested):
                tell(test)
            place = self.output if label is None else self.output / f"label_{label}"
            write_fit(fit, tested, shown, seconds, place, self.json)
            named[fit.kind if label is None else f"label {label}"] = fit
        if self.page is not None:
            from impostor_jax.page.fit_page import view

            view(named, shown.depth, shown.camera).save(self.page)
        return 0 if all(fit.success for fit in fits.values()) else 1

    def _check_cloud(self) -> None:
        """Raise a `ValueError` where a cloud is asked what images have, or is none."""
        of_images = {"--page": self.page, "--mask": self.mask, "--labels": self.labels}
        check_cloud(self.depth[0], "fit", of_images)
        if self.shape != "cylinder":
            raise ValueError(f"--shape must be cylinder of a cloud, got {self.shape}")

    def _items(self) -> "list[AbstractItem]":
        """What is fitted to."""
        from impostor_jax.many.inputs import items_of, views_of

        if self.views is not None:
            assert self.camera is not None
            return [views_of(self.depth, self.camera, self.mask, self.views)]
        meaning = "labels" if self.labels else "mask"
        return items_of(
            self.depth,
            self.camera,
            self.labels or self.mask,
            meaning,
            are_outlines=self.silhouette,
        )

    def _task(self, item: "AbstractItem") -> "FitTask":
        """What is done on images or on clouds, of which this is the first."""
        from impostor_jax.many.tasks import FitTask

        asked = {
            "sigma": chosen_noise(self.sigma, self.sensor, partial(camera_of, item)),
            "initial": start_of(self.initial, self.shape),
            "fixed": self.fixed,
            "prior": priors_of(self.prior_radius, self.prior_height),
            "mask_meaning": "outline" if self.silhouette else self.mask_meaning,
            "errors": self.errors,
            "effort": chosen_effort(self.effort, self.dials),
        }
        if self.origin is not None:
            asked["origin"] = self.origin
        if self.pose_sigma is not None:
            asked["pose_sigma"] = self.pose_sigma
        return FitTask(asked, self.shape, self.test_taper, self.test_bore)


def _region_taken(fit: "Fit") -> str:
    import numpy as np

    rows, cols = np.nonzero(np.asarray(fit.region))
    if not len(rows):
        return "no mask: no object is found"
    return (
        f"no mask: found an object of {len(rows)} pixels in rows "
        f"{rows.min()}-{rows.max()}, columns {cols.min()}-{cols.max()}"
    )
