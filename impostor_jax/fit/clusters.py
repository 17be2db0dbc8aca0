"""Outliers that lie together: what is on an object, and not of its shape.

A lid, a dome, a flange or a handle leaves its shape step by step. Where it has left it
by more than a robust loss bears, its readings are outliers, side by side; those before
that count, and all pull to one side: of a can with a domed cap, 1.5 percent of the
readings turned the axis by eight standard deviations, at a chi-squared of 1.4. Noise
makes outliers one by one. So where many lie together, they and those beside them are
left out, whatever these read.
"""

__all__ = ["clustered_outliers"]

import numpy as np
from jaxtyping import Bool

from impostor_jax.camera.ray_table import shows_image
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.pixelwise import Pixelwise
from impostor_jax.fit.regions import SQUARE
from impostor_jax.fit.seen import Seen
from impostor_jax.fit.touching import OFF, sigmas_off
from impostor_jax.opencv import cv2

FEWEST = 20
"""Outliers that lie together: of 300 drawn cans there were two at most."""

BESIDE = 2
"""Pixels beside them that may be of the same."""


def clustered_outliers(
    seen: Seen, body: AbstractBody, told: Pixelwise
) -> Bool[np.ndarray, "h w"]:
    """Pixels of outliers that lie together, and those beside them; none of points.

    Args:
        seen: An object.
        body: What was fitted to it, in the world frame.
        told: What the fit tells of its readings.
    """
    if not shows_image(seen.camera):
        return np.zeros_like(seen.region)
    outliers = np.asarray(told.image(np.asarray(told.marks) == 1))
    num_taken = np.count_nonzero(np.asarray(told.place) < seen.region.size)
    if num_taken < np.count_nonzero(seen.region) / 2:
        # Too few for any to lie together.
        outliers = np.abs(sigmas_off(seen, body)) > OFF
    if np.count_nonzero(outliers) < FEWEST:
        return np.zeros_like(seen.region)
    _, labels = cv2.connectedComponents(outliers.astype(np.uint8), connectivity=8)
    large = np.flatnonzero(np.bincount(labels.ravel()) >= FEWEST)
    # The first is what is no outlier.
    clusters = np.isin(labels, large[large > 0])
    return cv2.dilate(clusters.astype(np.uint8), SQUARE, iterations=BESIDE) > 0
