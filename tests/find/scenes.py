"""Noisy images of few shapes, of one size, so that little is compiled."""

from typing import NamedTuple

import jax
import numpy as np

import impostor_jax as ij
from impostor_jax.find.evidence import Candidate, Scene
from impostor_jax.find.normals import normals_of, stray
from impostor_jax.find.planes import planes_of
from impostor_jax.find.view import view_of
from tests.fit.scenes import CAMERA, camera_with

SIZE = {"width": 160, "height": 120}
LENS = camera_with(distortion=(-0.2, 0.05, 0.002, -0.001, 0.01))
ORTHOGRAPHIC = ij.OrthographicCamera(400.0, 400.0, 79.5, 59.5, **SIZE)
CAMERAS = {"pinhole": CAMERA, "lens": LENS, "orthographic": ORTHOGRAPHIC}
SIGMA = 0.001
WALL = ij.Plane((0.0, 0.0, 0.6), (0.0, 0.0, -1.0))


class Image(NamedTuple):
    """Readings, depth without noise, normals, and the number of the shape seen."""

    depth: np.ndarray
    exact: np.ndarray
    normal: np.ndarray
    owner: np.ndarray


@jax.jit
def rendered(shape, camera):
    """Depth and normals of a shape."""
    maps = ij.render(shape, camera)
    return maps.depth, maps.normal


def image_of(shapes, camera=CAMERA, sigma=SIGMA, seed=0):
    """An image of some shapes; 0 where there is nothing."""
    maps = [rendered(shape, camera) for shape in shapes]
    depths, normals = (np.array(part) for part in zip(*maps, strict=True))
    owner = depths.argmin(axis=0)
    exact = np.take_along_axis(depths, owner[None], axis=0)[0]
    normal = np.take_along_axis(normals, owner[None, ..., None], axis=0)[0]
    hit = np.isfinite(exact)
    exact = np.where(hit, exact, 0)
    noise = np.random.default_rng(seed).normal(0, sigma, exact.shape)
    depth = np.where(hit, exact + noise, 0).astype(np.float32)
    return Image(depth, exact, normal, np.where(hit, owner, -1))


def seen(image, camera=CAMERA, sigma=SIGMA, most_pixels=10**6):
    """The view of an image."""
    return view_of(image, camera, ij.ConstantNoise(sigma), most_pixels)


def scene_of(image, camera=CAMERA, sigma=SIGMA, free=None):
    """The scene of an image, whose readings are all free, or its planes taken away."""
    view = seen(image.depth, camera, sigma)
    usable = view.valid & ~stray(view)
    normals = normals_of(view, usable)
    if free is None:
        planes = planes_of(view, usable).labels > 0
        free = usable & ~planes
    else:
        planes = np.zeros_like(usable)
    return Scene(view, normals, 1.0, usable, usable & free, planes)


def wall_of(can, side=1.0, **changes):
    """The wall of a cylinder, or of one that differs."""
    wall = Candidate(
        np.array(can.center, float), np.array(can.axis, float), float(can.radius), side
    )
    return wall._replace(**changes)


def ends_of(can):
    """Ends of its wall, from its center."""
    return -float(can.height) / 2, float(can.height) / 2
