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

OFF = 5.0
"""Deviations from which a reading is not the body's."""

FAR = 50.0
"""Deviations from which one is of a surface that does not touch the body's there."""

MARGIN = 3
"""Pixels beside a surface that does, whose readings may be of that and look like the
body's."""

DISAGREEING = 50.0
"""Contradiction between border and rest, of 7 degrees of freedom in a cylinder, from
which something else is taken to lie at the border: by chance once in 1e8 fits."""

AGREEING = 20.0
"""That below which it is not, once it has been found: by chance one in 200 is larger,
and costs no more than some readings."""

Fitted = Callable[[Bool[np.ndarray, "h w"]], tuple[AbstractFit, float]]
"""A fit of a region's pixels, and how its border contradicts the rest."""


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
        fitted: How to fit a region.
        kind: The body that is fitted.
        image: In meters; 0 where there is no reading.
        region: Pixels of the object, or more.
        camera: The camera.
        noise: Of the readings.
    """
    fit, chi2 = fitted(region)
    if chi2 < DISAGREEING:
        return fit
    for width in NARROWER:
        core = _narrowed(region, width)
        if np.count_nonzero(image[core]) < FEWEST_READINGS:
            break
        fit, chi2 = fitted(core)
        if chi2 < AGREEING:
            break
    if chi2 >= AGREEING or not bool(fit.success):
        return fit
    own = _own_pixels(image, region, kind.of(fit.shape), camera, noise)
    whole, chi2 = fitted(own)
    return whole if bool(whole.success) and chi2 < AGREEING else fit


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
) -> Bool[np.ndarray, "h w"]:
    """Pixels of a region that are a body's own beyond doubt.

    Only what is connected with the region's border by readings off the body is not its
    own: an outlier within is no border.
    """
    row, col = np.nonzero(region)
    away = np.zeros_like(image)
    away[row, col] = _deviations(image, row, col, body, camera, noise)
    off = away > OFF
    # A margin outside, which all that lies beside the image is connected by.
    other = np.pad(off | ~region, 1, constant_values=True).astype(np.uint8)
    _, labels = cv2.connectedComponents(other, connectivity=8)
    beside = (labels == labels[0, 0])[1:-1, 1:-1]
    kernel = np.ones((3, 3), np.uint8)
    touching = (beside & off & (away < FAR)).astype(np.uint8)
    doubtful = cv2.dilate(touching, kernel, iterations=MARGIN) > 0
    return region & ~beside & ~doubtful


@jax.jit
def _deviations(
    image: Float[Array, "h w"],
    row: Int[Array, " n"],
    col: Int[Array, " n"],
    body: AbstractBody,
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
) -> Float[Array, " n"]:
    """How far readings lie off a body, in deviations; 0 where there is none.

    A reading near a wall that its ray misses is not the body's: the core tells radius
    and place to a small part of a pixel.
    """
    pixels = gather_pixels(image, camera, row, col)
    body = in_camera_frame(body, camera)
    seen = surface_seen(pixels.direction, body, body.radius / 100)
    read = pixels.depth > 0
    sigma = deviation(noise, jnp.where(read, pixels.depth, 1), seen.cos_incidence)
    away = jnp.abs(pixels.depth - seen.depth) / sigma
    away = jnp.where(seen.square < 0, jnp.maximum(away, 2 * OFF), away)
    return jnp.where(read, away, 0)
