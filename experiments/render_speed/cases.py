"""What is seen by one camera: many small cylinders, or shapes, all over the view."""

__all__ = [
    "OUTPUTS",
    "larger_can_loss",
    "make_many",
    "make_mixed",
    "rows_of",
    "squared_difference",
]

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import impostor_jax as ij
from experiments.scenes import make_can

OUTPUTS = ("depth", "normal", "index")
"""Maps of a scene."""


def make_many(count: int, seed: int) -> ij.Cylinder:
    """Random cylinders all over the view, 5 to 10 mm in radius and twice as long."""
    rng = np.random.default_rng(seed)
    low, high = (-0.6, -0.45, 0.8), (0.6, 0.45, 1.6)
    return ij.Cylinder(
        center=rng.uniform(low, high, (count, 3)),
        axis=rng.uniform(-1, 1, (count, 3)),
        radius=rng.uniform(0.005, 0.01, count),
        height=rng.uniform(0.02, 0.04, count),
    )


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


def rows_of(cylinders: ij.Cylinder) -> Float[np.ndarray, "n 8"]:
    """Center, axis, radius and height of one cylinder, or of each of a batch."""
    sizes = [np.asarray(x)[..., None] for x in (cylinders.radius, cylinders.height)]
    rows = np.concatenate([cylinders.center, cylinders.axis, *sizes], axis=-1)
    return np.atleast_2d(rows)


def squared_difference(
    depth: Float[Array, "h w"], target: Float[Array, "h w"]
) -> Float[Array, ""]:
    """Sum over the pixels where both see something, in square meters."""
    both = jnp.isfinite(depth) & jnp.isfinite(target)
    return jnp.sum((jnp.where(both, depth, 0) - jnp.where(both, target, 0)) ** 2)


def larger_can_loss(
    view: ij.PinholeCamera,
) -> Callable[[ij.Cylinder], Float[Array, ""]]:
    """Loss of a can's image against the depth of a can that is 2 % larger."""
    target = ij.render(make_can(grown=1.02), view, ("depth",)).depth
    assert target is not None

    def loss(can: ij.Cylinder) -> Float[Array, ""]:
        depth = ij.render(can, view, ("depth",)).depth
        assert depth is not None
        return squared_difference(depth, target)

    return loss
