"""The programs that are compared; a further one is a function and a line in `PROGRAMS`.

Its function is a `Program`: given an image's readings, its camera and the sensor's
noise, it returns detections. It knows nothing else of the presets.
"""

__all__ = ["OURS", "OUR_SOURCES", "PROGRAMS", "Entry", "fit_true_masks"]

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

import impostor_jax as ij
from experiments.find_accuracy.peers.cape import cape
from experiments.find_accuracy.peers.clouds import cgal, pcl, pyransac3d
from experiments.find_accuracy.program import Program
from impostor_jax.effort import MIN_READINGS
from impostor_jax.matching import Detection, detection_of

OURS = "impostor_jax"

OUR_SOURCES = ("impostor_jax",)
"""Folders whose files tell whether what we find has changed."""


class Entry(NamedTuple):
    """A program.

    Attributes:
        sentence: What it does, for a reader.
        function: It.
        sources: Folders whose files tell whether it has changed since it ran.
    """

    sentence: str
    function: Program
    sources: tuple[str, ...] = ("experiments/find_accuracy/peers",)


def _found(
    depth: Float[np.ndarray, "h w"],
    camera: ij.PinholeCamera,
    sensor: ij.AbstractDepthNoise,
    effort: str = "balanced",
) -> list[Detection]:
    found = ij.find_cylinders(depth, camera, sensor, effort=effort)
    return [
        detection_of(fit, float(confidence))
        for fit, confidence in zip(found.fits, found.confidence, strict=True)
    ]


def _found_fast(
    depth: Float[np.ndarray, "h w"],
    camera: ij.PinholeCamera,
    sensor: ij.AbstractDepthNoise,
) -> list[Detection]:
    return _found(depth, camera, sensor, "fast")


def fit_true_masks(
    image: ij.LabeledImage, sensor: ij.AbstractDepthNoise
) -> list[Detection]:
    """Fits of an image's cylinders, each given its pixels; NaN where one failed."""
    fits = []
    for mask in image.mask:
        detection = Detection(np.full(3, np.nan), np.full(3, np.nan), np.nan, np.nan, 1)
        if np.count_nonzero(image.depth[mask]) >= MIN_READINGS:
            fit = ij.fit_cylinder(image.depth, image.pinhole, mask=mask, sigma=sensor)
            if bool(fit.success):
                detection = detection_of(fit, 1.0)
        fits.append(detection)
    return fits


PROGRAMS: dict[str, Entry] = {
    OURS: Entry("`find_cylinders`, with no option set.", _found, OUR_SOURCES),
    f"{OURS} fast": Entry("The same with `effort='fast'`.", _found_fast, OUR_SOURCES),
    "PCL": Entry(
        "Planes are taken away, then cylinders by RANSAC with normals, one by one.", pcl
    ),
    "CGAL": Entry("Efficient RANSAC for planes and cylinders at once.", cgal),
    "CAPE": Entry("Cells of pixels, grown into planes and cylinders.", cape),
    "pyransac3d": Entry("As PCL, with cylinders through three points.", pyransac3d),
}
"""By name, which must have no point in it."""
