"""What is timed: a can seen by a 640x480 camera, and what is computed from it."""

__all__ = [
    "SIGMA",
    "jax_cases",
    "make_camera",
    "make_can",
    "make_many",
    "make_mixed",
    "noisy_image",
]

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import impostor_jax as ij

SIGMA = 0.001
"""Deviation of the fitted image's readings, in meters."""

WALL_DEPTH = 1.2
"""Depth of the wall behind the can, in meters."""

TILE_SHAPE = (96, 112)
"""Rows and columns of the tile that follows a traced cylinder."""


SHAPES = 1000
"""Number of shapes in a scene."""

SCENE_SEED = 1


def make_can(grown: float = 1.0) -> ij.Cylinder:
    """The can in the camera frame, its sizes multiplied by `grown`."""
    return ij.Cylinder((0, 0, 0.8), (0.3, 0.8, 0.52), 0.04 * grown, 0.12 * grown)


def make_camera(shrink: int = 1) -> ij.PinholeCamera:
    """The camera, or one of the same view and `shrink` times coarser pixels."""
    return ij.PinholeCamera(
        fx=525.0 / shrink,
        fy=525.0 / shrink,
        cx=320.0 / shrink - 0.5,
        cy=240.0 / shrink - 0.5,
        width=640 // shrink,
        height=480 // shrink,
    )


def make_many(count: int, seed: int) -> ij.Cylinder:
    """Random cylinders all over the view, 2 to 6 m away and 1 to 5 cm in radius."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(2.0, 6.0, count)
    x, y = rng.uniform(-0.6, 0.6, count) * z, rng.uniform(-0.45, 0.45, count) * z
    radius = np.exp(rng.uniform(np.log(0.01), np.log(0.05), count))
    height = radius * np.exp(rng.uniform(np.log(0.5), np.log(10), count))
    center, axis = np.stack([x, y, z], axis=-1), rng.normal(size=(count, 3))
    return ij.Cylinder(center, axis, radius, height)


def make_mixed(count: int, seed: int) -> ij.Scene:
    """The same cylinders, but three of four turned into other shapes of their size."""
    one = make_many(count, seed)
    center, axis = np.array(one.center), np.array(one.axis)
    radius, height = np.array(one.radius), np.array(one.height)
    rows = [np.arange(count) % 4 == k for k in range(4)]
    half = axis * (height / 2)[:, None]
    low, high = center - half, center + half
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(count, 3, 3)))[0]
    turn[np.linalg.det(turn) < 0] *= -1
    size = np.stack([2 * radius, 2 * radius, height], axis=-1)
    k, s, f, b = rows
    return ij.Scene(
        [
            ij.Cylinder(center[k], axis[k], radius[k], height[k]),
            ij.Sphere(center[s], radius[s]),
            ij.Frustum(low[f], high[f], radius[f], radius[f] / 2),
            ij.Box(center[b], turn[b], size[b]),
        ]
    )


def noisy_image(depth: Float[np.ndarray, "h w"], seed: int) -> Float[np.ndarray, "h w"]:
    """Depth image with a wall behind the can, and noise."""
    noise = np.random.default_rng(seed).normal(0, SIGMA, depth.shape)
    return (np.minimum(depth, WALL_DEPTH) + noise).astype(depth.dtype)


def jax_cases(
    can: ij.Cylinder, camera: ij.PinholeCamera, image: Float[np.ndarray, "h w"]
) -> dict[str, Callable[[], Any]]:
    """The calls to time, other than the whole frame that C draws too."""
    mask = np.asarray(ij.render(can, camera).mask)
    target = ij.render(make_can(grown=1.02), camera, ("depth",)).depth
    assert target is not None
    tile = ij.outline_tile(can, camera)

    def loss(cylinder: ij.Cylinder, tile: ij.Tile) -> Float[Array, ""]:
        depth = ij.render(cylinder, camera, ("depth",), tile).depth
        assert depth is not None
        corner, size = (tile.row, tile.col), (tile.height, tile.width)
        wanted = jax.lax.dynamic_slice(target, corner, size)
        both = jnp.isfinite(depth) & jnp.isfinite(wanted)
        return jnp.sum((jnp.where(both, depth, 0) - jnp.where(both, wanted, 0)) ** 2)

    def loss_on_own_tile(cylinder: ij.Cylinder) -> Float[Array, ""]:
        return loss(cylinder, ij.outline_tile(cylinder, camera, shape=TILE_SHAPE))

    outputs = ("depth", "normal", "index")
    cylinders = ij.Scene([make_many(SHAPES, SCENE_SEED)])
    mixed = make_mixed(SHAPES, SCENE_SEED)
    on_tile = jax.jit(jax.value_and_grad(lambda cylinder: loss(cylinder, tile)))
    on_own_tile = jax.jit(jax.value_and_grad(loss_on_own_tile))
    return {
        "depth_only": lambda: ij.render(can, camera, ("depth",)),
        "tile": lambda: ij.render(can, camera, tile=tile),
        "gradient_tile": lambda: on_tile(can),
        "gradient_own_tile": lambda: on_own_tile(can),
        "scene_cylinders": lambda: ij.render(cylinders, camera, outputs),
        "scene_mixed": lambda: ij.render(mixed, camera, outputs),
        "fit_mask": lambda: ij.fit_cylinder(image, camera, mask, SIGMA),
        "fit_no_mask": lambda: ij.fit_cylinder(image, camera, sigma=SIGMA),
    }
