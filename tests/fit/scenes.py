"""Noisy images of a can that the fit tests share.

One image size and few numbers of pixels, so that the fit is compiled once.
"""

import functools

import numpy as np

import impostor_jax as ij
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.fit.options import Options
from impostor_jax.fit.problem import Inputs
from impostor_jax.fit.program import Program
from impostor_jax.fit.request import checked_noise, checked_prior, checked_settings
from impostor_jax.fit.seen import Seen, shown_by

SIGMA = 0.001


def camera_with(**more) -> ij.PinholeCamera:
    """Of the tests' images, with a lens or a pose."""
    return ij.PinholeCamera(150.0, 150.0, 79.5, 59.5, width=160, height=120, **more)


CAMERA = camera_with()


def can(degrees: float = 60.0) -> ij.Cylinder:
    """A can whose axis makes an angle with the view."""
    angle = np.radians(degrees)
    axis = (0.6 * np.sin(angle), 0.8 * np.sin(angle), np.cos(angle))
    return ij.Cylinder((0.01, 0.005, 0.35), axis, radius=0.04, height=0.12)


@functools.cache
def image(degrees: float = 60.0, wall: float | None = 0.6, seed: int = 0):
    """Depth image with noise, and the mask of the can."""
    return image_of(can(degrees), wall, seed)


def image_of(shape, wall: float | None = 0.6, seed: int = 0):
    """Depth image of any shape with noise, and its mask."""
    maps = ij.render(shape, CAMERA, outputs=("depth", "mask"))
    mask = np.asarray(maps.mask)
    behind = np.inf if wall is None else wall
    depth = np.minimum(np.asarray(maps.depth), behind)
    noise = np.random.default_rng(seed).normal(0, SIGMA, depth.shape)
    return (depth + noise).astype(np.float32), mask


def program_of(start=None, readings=None, least=0, **options):
    """The compiled fit of the can's image, of errors that are independent."""
    depth, mask = image()
    asked = Options(**options)
    seen = Seen(depth, mask, CAMERA, checked_noise(SIGMA))
    table = shown_by(seen, readings, least=least)
    settings = checked_settings(CYLINDER, asked, start, SIGMA)
    known = checked_prior(None, CYLINDER.parameters, None)
    inputs = Inputs(known, settings, (table,), asked.effort.kernel)
    return Program(inputs, correlated=False)


def with_outliers(depth, share, seed=0):
    """Of which some readings are anywhere within 20 cm of where they were."""
    rng = np.random.default_rng(seed)
    is_wrong = rng.random(depth.shape) < share
    off = rng.uniform(-0.2, 0.2, depth.shape)
    return np.where(is_wrong, np.maximum(depth + off, 0.05), depth).astype(np.float32)
