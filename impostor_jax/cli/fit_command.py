"""The command `impostor-jax fit`."""

__all__ = ["FitCommand"]

import dataclasses
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import tyro

from impostor_jax.cli.dials import Dials, EffortName, chosen_effort
from impostor_jax.cli.given import (
    chosen_noise,
    files_of,
    hints_on_stderr,
    places_of,
    priors_of,
    start_of,
)
from impostor_jax.cli.inputs import (
    check_images,
    check_noise,
    check_page,
    check_single_image,
)

if TYPE_CHECKING:
    from impostor_jax.camera.base import AbstractCamera
    from impostor_jax.fit.bore import BoreTest
    from impostor_jax.fit.result import Fit
    from impostor_jax.fit.taper import TaperTest


@dataclasses.dataclass(frozen=True)
class FitCommand:
    """Fit a capped cylinder, or another shape, to depth images.

    Writes fit.json and overlay.png; of several images each into a folder of its name,
    of several labels each into a folder label_N. With --page, a page for a browser,
    too, on which readings and shapes are turned with the mouse. The exit code is 0 if
    all fits succeeded, 1 if one failed and 2 if the input is bad.
    """

    depth: tyro.conf.Positional[tuple[Path, ...]]
    """Depth images: 16-bit PNG, or meters as floating-point TIFF or NPY."""
    camera: Path
    """Camera file (JSON): fx, fy, cx, cy, width, height, depth_scale_m, distortion."""
    mask: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """Mask image, not 0 on the object; an object is searched for if none is given. Of
    several depth images once for each, or a folder of PNG files of their names."""
    labels: tyro.conf.UseAppendAction[tuple[Path, ...]] = ()
    """Label image instead of a mask: 0 where there is no object, otherwise its number;
    each object is fitted. Of several depth images as masks are given."""
    shape: Literal["cylinder", "sphere", "frustum", "tube", "box"] = "cylinder"
    """What is fitted."""
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

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from impostor_jax.cli.ending import stream_beside
        from impostor_jax.io.atomic import (
            check_output_file,
            check_output_folder,
            write_json,
        )

        places = places_of(self.depth, self.output)
        masks = files_of("--mask", self.mask, self.depth)
        labels = files_of("--labels", self.labels, self.depth)
        if masks and labels:
            raise ValueError("--mask must not be given together with --labels")
        if self.json is not None and (labels or len(places) > 1):
            raise ValueError(
                "--json must not be given with --labels or several images: each fit "
                "has a fit.json of its own"
            )
        check_single_image(self.page, len(places) == 1)
        effort = chosen_effort(self.effort, self.dials)
        self._check_files(masks, labels)
        # These start JAX.
        from impostor_jax.io.camera_file import read_camera
        from impostor_jax.io.depth_image import read_depth
        from impostor_jax.viewer.figure import write_overlay

        camera, depth_scale_m = read_camera(self.camera)
        asked = self._asked(camera) | {"effort": effort}
        for place in places:
            check_output_folder(place, () if labels else ("fit.json", "overlay.png"))
        if self.json is not None:
            check_output_file(self.json, "json")
        check_page(self.page)
        # Lines for a reader go elsewhere if the record, or the page, is printed.
        tell = partial(print, file=stream_beside(self.json, self.page))
        succeeded = []
        for index, place in enumerate(places):
            size = camera.height, camera.width
            depth = read_depth(self.depth[index], depth_scale_m, size)
            if len(places) > 1:
                tell(f"{self.depth[index]}:")
            given = (labels or masks or [None] * len(places))[index]
            fits, tests, seconds = self._fits(given, depth, camera, asked)
            for (name, fit), (taper, bore) in zip(fits.items(), tests, strict=True):
                if labels:
                    tell(f"{name.replace('_', ' ')}:")
                elif not masks:
                    tell(_region_taken(fit))
                tell(fit.summary(seconds))
                for test in (taper, bore):
                    if test is not None:
                        tell(test)
                folder = place / name
                write_json(
                    folder / "fit.json" if self.json is None else self.json,
                    fit.to_dict(seconds, taper, bore),
                )
                write_overlay(folder / "overlay.png", fit, depth, camera)
                succeeded.append(bool(fit.success))
            if self.page is not None:
                from impostor_jax.page.fit_page import view

                named = {
                    name.replace("_", " ") or fit.kind: fit
                    for name, fit in fits.items()
                }
                view(named, depth, camera).save(self.page)
        return 0 if all(succeeded) else 1

    def _check_files(self, masks: list[Path], labels: list[Path]) -> None:
        """Raise where files or flags are seen to be bad without JAX."""
        from impostor_jax.io.scene_record import read_scene_record

        check_noise(self.sigma, self.sensor)
        beside = {"mask": masks, "label image": labels}
        check_images(self.camera, self.depth, beside)
        if self.initial is not None:
            read_scene_record(self.initial)

    def _asked(self, camera: "AbstractCamera") -> dict[str, Any]:
        """What a fit takes by name, but the mask and the effort."""
        tests = {"--test-taper": self.test_taper, "--test-bore": self.test_bore}
        for name, is_asked in tests.items():
            if is_asked and self.shape != "cylinder":
                raise ValueError(f"{name} must not be given for a {self.shape}")
        return {
            "sigma": chosen_noise(self.sigma, self.sensor, camera),
            "initial": start_of(self.initial, self.shape),
            "fixed": self.fixed,
            "prior": priors_of(self.prior_radius, self.prior_height),
            "mask_meaning": self.mask_meaning,
            "errors": self.errors,
        }

    def _fits(
        self,
        given: Path | None,
        depth: Any,
        camera: "AbstractCamera",
        asked: dict[str, Any],
    ) -> "tuple[dict[str, Fit], list[tuple[TaperTest | None, BoreTest | None]], float]":
        """Fits of an image's objects, by their folders; tests of them; the seconds.

        Args:
            given: File of its mask or its labels, if there is one.
            depth: The image.
            camera: The camera.
            asked: As of `_asked`, with the effort.
        """
        import jax

        from impostor_jax.fits.labels import fit_labels
        from impostor_jax.io.label_image import read_labels, read_one_mask

        function, size = self._function(), (camera.height, camera.width)
        read = read_labels if self.labels else read_one_mask
        pixels = None if given is None else read(given, size)
        start = time.perf_counter()
        with hints_on_stderr():
            if self.labels:
                found = fit_labels(depth, camera, pixels, function, **asked)
                fits = {f"label_{label}": fit for label, fit in found.items()}
            else:
                fits = {"": function(depth, camera, mask=pixels, **asked)}
            tests = [(self._taper(fit), self._bore(fit)) for fit in fits.values()]
        jax.block_until_ready([fit.rms for fit in fits.values()])
        return fits, tests, time.perf_counter() - start

    def _function(self) -> Any:
        """What fits the shape."""
        from impostor_jax.fits.single import (
            fit_box,
            fit_cylinder,
            fit_frustum,
            fit_sphere,
            fit_tube,
        )

        return {
            "cylinder": fit_cylinder,
            "sphere": fit_sphere,
            "frustum": fit_frustum,
            "tube": fit_tube,
            "box": fit_box,
        }[self.shape]

    def _taper(self, fit: "Fit") -> "TaperTest | None":
        """Whether a frustum is needed, where that is asked and an object was seen."""
        from impostor_jax.fit.taper import test_taper

        is_tested = self.test_taper and fit.asked.arguments is not None
        return test_taper(fit) if is_tested else None

    def _bore(self, fit: "Fit") -> "BoreTest | None":
        """Whether a tube is needed, likewise."""
        from impostor_jax.fit.bore import test_bore

        is_tested = self.test_bore and fit.asked.arguments is not None
        return test_bore(fit) if is_tested else None


def _region_taken(fit: "Fit") -> str:
    import numpy as np

    rows, cols = np.nonzero(np.asarray(fit.region))
    if not len(rows):
        return "no mask: no object is found"
    return (
        f"no mask: found an object of {len(rows)} pixels in rows "
        f"{rows.min()}-{rows.max()}, columns {cols.min()}-{cols.max()}"
    )
