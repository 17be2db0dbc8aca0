"""Scenes whose incidence is known, and their readings."""

import jax
import jax.numpy as jnp
import numpy as np

from tests.cases import CAMERAS
from tests.checks import QUICKLY

CAMERA = CAMERAS["pinhole"]()
SHAPE = (CAMERA.height, CAMERA.width)
COUNT = 16


def readings(noise, depth, angle=0.0, seed=0, normal=None):
    """`COUNT` images, (COUNT, h, w), of a depth image at an incidence in radians.

    Or of one whose normal is given. In single precision: the contract tests run both.
    """
    depth = np.broadcast_to(depth, SHAPE).astype(np.float32)
    normal = normals(angle) if normal is None else normal
    normal = np.where(np.isfinite(depth)[..., None], normal, 0)
    return np.asarray(_read(noise, jax.random.key(seed), depth, np.float32(normal)))


@jax.jit(compiler_options=QUICKLY)
def _read(noise, key, depth, normal):
    def sample(key):
        return noise.sample(key, depth, normal, CAMERA)

    return jax.vmap(sample)(jax.random.split(key, COUNT))


@jax.jit(compiler_options=QUICKLY)
def _sigma(noise, depth, cosine):
    return noise.sigma(depth, cosine)


def sigma_of(noise, depth, cosine):
    """Its sigma, with arguments of one shape and precision."""
    depth, cosine = np.broadcast_arrays(depth, cosine)
    dtype = jnp.result_type(float)
    return np.asarray(_sigma(noise, depth.astype(dtype), cosine.astype(dtype)))


def normals(angle):
    """Normals at an angle to the viewing rays, in radians; one or one a pixel."""
    row, col = np.mgrid[: SHAPE[0], : SHAPE[1]]
    x, y = (col - CAMERA.cx) / CAMERA.fx, (row - CAMERA.cy) / CAMERA.fy
    view = np.stack([x, y, np.ones_like(x)], axis=-1)
    view /= np.linalg.norm(view, axis=-1, keepdims=True)
    across = np.cross(view, (0.3, 1.0, 0.2))
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    angle = np.broadcast_to(angle, SHAPE)[..., None]
    return np.sin(angle) * across - np.cos(angle) * view


def bands(values, axis):
    """An image of equal bands of the values, along rows (0) or columns (1)."""
    indices = np.arange(SHAPE[axis]) * len(values) // SHAPE[axis]
    band = np.asarray(values)[indices]
    return np.broadcast_to(band[:, None] if axis == 0 else band[None], SHAPE)
