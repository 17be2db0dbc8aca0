"""The command `impostor-jax fit`."""

__all__ = ["Fit", "summary"]

import dataclasses
import time
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from impostor_jax.cli.dials import Dials, Preset, chosen_effort

if TYPE_CHECKING:
    from impostor_jax.fit.result import FitResult, TaperTest


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
    """File for the record of the fit, instead of fit.json in the output folder; "-" is
    the standard output."""
    effort: Preset = "balanced"
    """How much work it takes; each dial may be set apart from it."""
    dials: Dials = dataclasses.field(default_factory=Dials)

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from impostor_jax.cli.ending import stream_beside
        from impostor_jax.fit.cylinder import fit_cylinder
        from impostor_jax.io.atomic import (
            check_output_file,
            check_output_folder,
            write_json,
        )
        from impostor_jax.io.camera_file import read_camera
        from impostor_jax.io.depth_image import read_depth, read_mask
        from impostor_jax.io.record import fit_record
        from impostor_jax.viewer.figure import write_overlay

        effort = chosen_effort(self.effort, self.dials)
        camera, depth_scale_m = read_camera(self.camera)
        size = camera.height, camera.width
        depth = read_depth(self.depth, depth_scale_m, size)
        mask = None if self.mask is None else read_mask(self.mask, size)
        record = self.output / "fit.json" if self.json is None else self.json
        check_output_folder(self.output, ("fit.json", "overlay.png"))
        if self.json is not None:
            check_output_file(self.json, "json")
        reader = stream_beside(record)
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
            print(_region_taken(fit), file=reader)
        print(summary(fit, seconds), file=reader)
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


def summary(fit: "FitResult", seconds: float) -> str:
    """A few lines for a reader; lengths in millimeters, angles in degrees."""
    import numpy as np

    head = (
        f"{fit.status}: {fit.status.meaning} {int(fit.num_steps)} steps, "
        f"{int(fit.num_agreeing)} of {int(fit.num_starts)} starts agree, "
        f"{int(fit.num_pixels)} pixels, {seconds:.2f} s"
    )
    if not bool(fit.success):
        return head
    cylinder, std = fit.cylinder, fit.std

    def row(name: str, values, deviations, factor: float, unit: str) -> str:
        numbers = " ".join(f"{factor * x:.3f}" for x in np.atleast_1d(values))
        spread = " ".join(f"{factor * x:.3f}" for x in np.atleast_1d(deviations))
        return f"  {name:<8}{numbers} {unit}  (std {spread})"

    tilt = " ".join(f"{x:.3f}" for x in np.degrees(np.asarray(std.axis)))
    direction = " ".join(f"{x:.5f}" for x in np.asarray(cylinder.axis))
    lines = [
        head,
        row("center", cylinder.center, std.center, 1e3, "mm"),
        f"  axis    {direction}  (std {tilt} degrees)",
        row("radius", cylinder.radius, std.radius, 1e3, "mm"),
        row("height", cylinder.height, std.height, 1e3, "mm"),
        f"  rms     {1e3 * float(fit.rms):.3f} mm over "
        f"{int(np.count_nonzero(fit.inliers))} inliers",
    ]
    if fit.taper is not None:
        lines.append(_taper(fit.taper))
    if not fit.height_observed:
        across = " ".join(f"{1e3 * x:.3f}" for x in np.asarray(std.across_axis))
        lines.append(
            "  An end is not seen: height is the visible extent, center its middle; "
            f"across the axis the center's std is {across} mm."
        )
    return "\n".join(lines)


def _taper(taper: "TaperTest") -> str:
    found = taper.frustum
    if not bool(found.success):
        return f"  taper   not tested: the frustum's fit ended as {found.status}"
    radii = f"{1e3 * found.frustum.radius1:.3f} to {1e3 * found.frustum.radius2:.3f} mm"
    answer = "needed" if bool(taper.is_needed()) else "not needed"
    return (
        f"  taper   {answer}: radius {radii} along the axis, likelihood ratio "
        f"{float(taper.statistic):.2f}, p-value {float(taper.p_value):.2g}"
    )
