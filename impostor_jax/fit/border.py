"""What of a region is of one surface: a mask may be too large.

A mask that was drawn by hand or comes from color goes on past the object. Its outermost
readings are of what lies beside that, and a table that touches a can pulls at the wall
without being an outlier. Where readings beside the border of a region disagree with the
others, only its core is fitted. The body that the core shows then tells which of the
other pixels are its own, and these are fitted once more.
"""

__all__ = ["fit_of_one_surface"]

from collections.abc import Callable

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.evidence import deviation, gather_pixels
from impostor_jax.fit.residuals import surface_seen
from impostor_jax.fit.result import AbstractFit
from impostor_jax.primitives.base import in_camera_frame
from impostor_jax.sensor.base import AbstractDepthNoise

NARROWER = (2, 4, 6, 8)
"""Pixels by which a region is made narrower, one after the other, until the readings
beside its border agree with the others."""

FEWEST_READINGS = 100
"""Readings that a core has at least."""

MARGIN = 2
"""Pixels beside what is not the body's in which a reading may be of that, and look like
the body's."""

OFF = 5.0
"""Deviations from which a reading is not the body's."""

Fitted = Callable[
    [Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"]], tuple[AbstractFit, bool]
]
"""A fit of an image's pixels, and whether the border of the region refutes it."""


def fit_of_one_surface(
    fitted: Fitted,
    kind: type[AbstractBody],
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
) -> AbstractFit:
    """Fit to a region, or to what of it is of one surface.

    Args:
        fitted: How to fit.
        kind: The body that is fitted.
        image: In meters; 0 where there is no reading.
        region: Pixels of the object, or more.
        camera: The camera.
        noise: Of the readings.
    """
    fit, border_is_off = fitted(image, region)
    if not border_is_off:
        return fit
    for width in NARROWER:
        core = _narrowed(region, width)
        if np.count_nonzero(image[core]) < FEWEST_READINGS:
            break
        fit, border_is_off = fitted(image, core)
        if not border_is_off:
            break
    if border_is_off or not bool(fit.success):
        return fit
    whole, border_is_off = fitted(
        *_own_pixels(image, region, kind.of(fit.shape), camera, noise)
    )
    return fit if border_is_off or not bool(whole.success) else whole


def _narrowed(region: Bool[np.ndarray, "h w"], width: int) -> Bool[np.ndarray, "h w"]:
    """A region without the pixels beside its border, but for the image's."""
    kernel = np.ones((3, 3), np.uint8)
    return cv2.erode(region.astype(np.uint8), kernel, iterations=width) > 0


def _own_pixels(
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    body: AbstractBody,
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
) -> tuple[Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """The image without readings beside what is not the body's, and what is its own.

    Only what is connected with the region's border by readings off the body is not its
    own: an outlier within is no border.
    """
    row, col = np.nonzero(region)
    off = np.zeros_like(region)
    off[row, col] = _is_off(image, row, col, body, camera, noise)
    # A margin outside, which all that lies beside the image is connected by.
    other = np.pad(off | ~region, 1, constant_values=True).astype(np.uint8)
    _, labels = cv2.connectedComponents(other, connectivity=8)
    beside = (labels == labels[0, 0])[1:-1, 1:-1]
    kernel = np.ones((3, 3), np.uint8)
    strange = cv2.dilate((beside & off).astype(np.uint8), kernel, iterations=MARGIN) > 0
    return np.where(strange, 0, image).astype(image.dtype), region & ~beside


@jax.jit
def _is_off(
    image: Float[Array, "h w"],
    row: Int[Array, " n"],
    col: Int[Array, " n"],
    body: AbstractBody,
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
) -> Bool[Array, " n"]:
    """Which readings lie off a body of the world."""
    pixels = gather_pixels(image, camera, row, col)
    body = in_camera_frame(body, camera)
    seen = surface_seen(pixels.direction, body, body.radius / 100)
    read = pixels.depth > 0
    sigma = deviation(noise, jnp.where(read, pixels.depth, 1), seen.cos_incidence)
    return read & (jnp.abs(pixels.depth - seen.depth) > OFF * sigma)
