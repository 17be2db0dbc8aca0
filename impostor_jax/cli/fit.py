"""The command `impostor-jax fit`."""

__all__ = ["Fit"]

import dataclasses
import time
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from impostor_jax.cli.dials import Dials, Preset, chosen_effort

if TYPE_CHECKING:
    from impostor_jax.fit.result import FitResult


@dataclasses.dataclass(frozen=True)
class Fit:
    """Fit a capped cylinder to a depth image.

    Writes fit.json and overlay.png. The exit code is 0 if the fit succeeded, 1 if it
    failed and 2 if the input is bad.
    """

    depth: tyro.conf.Positional[Path]
    """Depth image: 16-bit PNG, or meters as floating-point TIFF or NPY."""
    camera: Path
    """Camera file (JSON): fx, fy, cx, cy, width, height, depth_scale_m, distortion."""
    mask: Path | None = None
    """Mask image, not 0 on the object; the nearest object is taken if none is given."""
    sigma: float = 0.001
    """Standard deviation of a depth reading, in meters."""
    mask_meaning: Literal["region", "outline"] = "region"
    """Whether the mask is any part of the object or its edge is the silhouette."""
    errors: Literal["independent", "correlated"] = "independent"
    """How readings of neighboring pixels err; decides the reported deviations."""
    test_taper: bool = False
    """Whether to test if a frustum, a cup, is needed."""
    output: Path = Path(".")
    """Folder that the files are written to."""
    json: Path | None = None
    """File for the record of the fit, instead of fit.json in the output folder."""
    effort: Preset = "balanced"
    """How much work it takes; each dial may be set apart from it."""
    dials: Dials = dataclasses.field(default_factory=Dials)

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from impostor_jax.fit.cylinder import fit_cylinder
        from impostor_jax.io.atomic import write_json
        from impostor_jax.io.camera_file import read_camera
        from impostor_jax.io.depth_image import read_depth, read_mask
        from impostor_jax.io.record import fit_record
        from impostor_jax.viewer.figure import write_overlay

        effort = chosen_effort(self.effort, self.dials)
        camera, depth_scale_m = read_camera(self.camera)
        depth = read_depth(self.depth, depth_scale_m)
        mask = None if self.mask is None else read_mask(self.mask)
        start = time.perf_counter()
        fit = fit_cylinder(
            depth,
            camera,
            mask=mask,
            sigma=self.sigma,
            mask_meaning=self.mask_meaning,
            errors=self.errors,
            effort=effort,
            test_taper=self.test_taper,
        )
        fit.rms.block_until_ready()
        seconds = time.perf_counter() - start
        if mask is None:
            print(_region_taken(fit))
        print(fit.summary(seconds))
        record = self.output / "fit.json" if self.json is None else self.json
        write_json(record, fit_record(fit, seconds))
        write_overlay(self.output / "overlay.png", fit, depth, camera)
        return 0 if bool(fit.success) else 1


def _region_taken(fit: "FitResult") -> str:
    import numpy as np

    rows, cols = np.nonzero(np.asarray(fit.region))
    return (
        f"no mask: took the nearest object in front of its surroundings, {len(rows)} "
        f"pixels in rows {rows.min()}-{rows.max()}, columns {cols.min()}-{cols.max()}"
    )
