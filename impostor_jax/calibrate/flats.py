"""What an image shows of planes, and how far its readings lie off them.

Errors over depth to the power with which they grow are alike all over a plane. Readings
near a jump, a hole or a crease are left out: there a sensor leans, which is no noise.
"""

__all__ = ["Flat", "flat_of"]

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.find.planes import planes_of
from impostor_jax.find.view import View, view_of
from impostor_jax.sensor.base import AbstractDepthNoise

FEWEST_PIXELS = 300
"""Of a plane: fewer tell its own three numbers and little else."""

NUM_FITS = 3
"""Times a plane is fitted, each with the depths that the last one has."""

SQUARE = np.ones((3, 3), np.uint8)
"""A pixel and its eight neighbors."""


class Flat(NamedTuple):
    """The planes of an image. All is 0 where there is none.

    Attributes:
        labels: Number of the plane from 1.
        depth: Of the plane, in meters.
        cosine: Of the incidence.
        error: Readings less the plane, over its depth to the power.
        terms: What the error changes by with each of a plane's three numbers.
    """

    labels: Int[np.ndarray, "h w"]
    depth: Float[np.ndarray, "h w"]
    cosine: Float[np.ndarray, "h w"]
    error: Float[np.ndarray, "h w"]
    terms: Float[np.ndarray, "3 h w"]

    @property
    def num_planes(self) -> int:
        """Number of planes."""
        return int(self.labels.max(initial=0))


def flat_of(
    depth: Float[np.ndarray, "h w"],
    camera: AbstractCamera,
    usable: Bool[np.ndarray, "h w"],
    noise: AbstractDepthNoise,
    power: float,
    margin: int,
) -> Flat:
    """The planes of an image.

    Args:
        depth: Readings in meters; 0 where there is none.
        camera: That took them.
        usable: Pixels that may be used.
        noise: Of the readings, in which all deviations from planes are counted.
        power: Of the depth, with which errors grow.
        margin: Pixels beside the edge of what lies on a plane that are left out.
    """
    view = view_of(depth, camera, noise, depth.size)
    labels = planes_of(view, view.valid & usable).labels
    none, terms = np.zeros(labels.shape), np.zeros((3, *labels.shape))
    found = Flat(np.zeros_like(labels), none, none.copy(), none.copy(), terms)
    number = 0
    for label in range(1, labels.max(initial=0) + 1):
        on = _without_border(labels == label, margin)
        if np.count_nonzero(on) >= FEWEST_PIXELS:
            number += 1
            found.labels[on] = number
            _fit(view, on, power, found)
    return found


def _without_border(
    region: Bool[np.ndarray, "h w"], margin: int
) -> Bool[np.ndarray, "h w"]:
    """A region's pixels that are farther than a margin from its edge.

    A hole of a pixel or two is a reading that is missing, and no edge.
    """
    # Beyond the image nothing is on the plane: there a window is cut as at an edge.
    whole = np.pad(region.view(np.uint8), margin + 1)
    whole = cv2.morphologyEx(whole, cv2.MORPH_CLOSE, SQUARE)
    inner = cv2.erode(whole, SQUARE, iterations=margin) > 0
    return region & inner[margin + 1 : -margin - 1, margin + 1 : -margin - 1]


def _fit(view: View, on: Bool[np.ndarray, "h w"], power: float, found: Flat) -> None:
    """Fit a plane to pixels, all of one weight, and write down what it says of them."""
    x, y, z = (part[on].astype(float) for part in (view.x, view.y, view.depth))
    rows = np.stack([x, y, np.ones_like(x)])
    linear = 1 / z if view.is_central else z
    grows = 2 - power if view.is_central else -power
    plane, middle = np.zeros(3), z
    for _ in range(NUM_FITS):
        scale = middle**grows
        plane = np.linalg.lstsq((rows * scale).T, linear * scale)[0]
        middle = 1 / (plane @ rows) if view.is_central else plane @ rows
    # Of a n . p = 1, and of z = a x + b y + c.
    normal = plane if view.is_central else plane * [1, 1, 0] - [0, 0, 1]
    cosine = np.abs(view.views[on] @ normal) / np.linalg.norm(normal)
    found.depth[on] = middle
    found.cosine[on] = np.clip(cosine, 0, 1)
    found.error[on] = (z - middle) / middle**power
    found.terms[:, on] = rows * middle**grows
