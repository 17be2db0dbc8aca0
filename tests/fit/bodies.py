"""Bodies that tests of the fit's parts share, and rays that see them."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

import impostor_jax as ij
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.fittable import KINDS
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import product

BODIES = {
    "cylinder": lambda: ij.Cylinder((0.02, 0.01, 0.8), (0.3, 0.8, 0.52), 0.1, 0.3),
    "cylinder around the camera": lambda: ij.Cylinder(
        (0.02, 0.01, 0.1), (0.3, 0.2, 0.9), 0.2, 0.6
    ),
    "cylinder along the view": lambda: ij.Cylinder((0, 0, 0.8), (0, 0, 1), 0.1, 0.3),
    "frustum": lambda: ij.Frustum((0.0, -0.1, 0.75), (0.05, 0.1, 0.85), 0.12, 0.05),
    "frustum around the camera": lambda: ij.Frustum(
        (0.0, -0.2, -0.2), (0.05, 0.2, 0.4), 0.15, 0.3
    ),
    "frustum from its narrow end": lambda: ij.Frustum(
        (0.0, 0.01, 0.7), (0.0, 0.0, 1.0), 0.05, 0.12
    ),
    "frustum from its wide end": lambda: ij.Frustum(
        (0.0, 0.01, 0.7), (0.0, 0.0, 1.0), 0.12, 0.05
    ),
    "cone within its opening": lambda: ij.Frustum(
        (0.0, 0.02, 0.5), (0.05, 0.03, 0.7), 0.001, 0.3
    ),
    "tube": lambda: ij.tube((0.02, 0.01, 0.8), (0.3, 0.4, 0.87), 0.1, 0.07, 0.3),
    "tube along the view": lambda: ij.tube((0, 0, 0.8), (0, 0, 1), 0.1, 0.09, 0.3),
    "tube around the camera": lambda: ij.tube(
        (0.02, 0.01, 0.1), (0.3, 0.2, 0.9), 0.25, 0.2, 0.6
    ),
    "sphere": lambda: ij.Sphere((0.05, 0.0, 0.8), 0.15),
    "sphere around the camera": lambda: ij.Sphere((0.05, 0.0, 0.2), 0.5),
}
"""By what of them is seen; in front of the camera or around it."""

FAR = {
    "cylinder at 5 m": lambda: ij.Cylinder(
        (0.4, -0.3, 5.0), (0.3, 0.8, 0.52), 0.1, 0.3
    ),
    "cylinder at 100 m": lambda: ij.Cylinder((4, -3, 100), (0.3, 0.8, 0.52), 0.1, 0.3),
    "frustum at 100 m": lambda: ij.Frustum(
        (4, -3.1, 99.95), (4.05, -2.9, 100.05), 0.12, 0.05
    ),
    "tube at 100 m": lambda: ij.tube((4, -3, 100), (0.3, 0.4, 0.87), 0.1, 0.07, 0.3),
    "sphere at 100 m": lambda: ij.Sphere((4, -3, 100), 0.15),
    "pipe with its center behind": lambda: ij.Cylinder(
        (0.02, 0.01, -0.4), (0.1, 0.05, 0.99), 0.2, 2.0
    ),
    "pipe with its center beside": lambda: ij.Cylinder(
        (0.5, 0.1, 0.02), (0.1, 0.0, 0.99), 0.1, 4.0
    ),
    "sphere with its center behind": lambda: ij.Sphere((0.05, 0.0, -0.2), 0.5),
}
"""Those that are far away, and those whose center is not in front of the camera."""


def body_of(shape) -> AbstractBody:
    return KINDS[type(shape)].body.of(shape)


def rays(shape, dtype, count: int = 1000) -> Vec3:
    """Directions all over a shape: in both precisions the same.

    Of what is near, the one along the view is among them.
    """
    center = np.array(body_of(shape).center, float)
    is_far = center[2] > 2
    middle = np.round(center[:2] / center[2], 4) if is_far else np.zeros(2)
    width = 0.25 / center[2] if is_far else 0.4
    offset = np.random.default_rng(0).uniform(-width, width, (2, count))
    offset[:, 0] = 0
    x, y = jnp.asarray((middle[:, None] + offset).astype(np.float32), dtype)
    return Vec3(x, y, jnp.ones_like(x))


@functools.cache
def in_double(name: str):
    """The shape of that name, of numbers that single precision holds."""
    with jax.enable_x64(False):
        shape = (BODIES | FAR)[name]()
    with jax.enable_x64(True):
        # What is far keeps double precision.
        return jax.tree.map(
            lambda x: jnp.asarray(np.asarray(x, np.float32), float), shape
        )


@jax.jit
def moved_then_turned(body, tangent, move):
    """A body that moves in its own frame, and the same in another one."""
    free = body.free_directions(())
    there = body.transformed(move)
    carried = product(tangent, body.carried(move))
    return body.retracted(tangent, free).transformed(move), there.retracted(
        carried, free
    )
