"""Points of walls, floors and balls, as they lie on these."""

import numpy as np

from impostor_jax.camera.ray_table import turned_to


def wall(rng, count, center, axis, radius, length, arc=(-np.pi, np.pi), noise=0.0):
    """Points on the wall of a cylinder, over an arc about its axis: of z, from y."""
    frame = turned_to(np.asarray(axis, float))
    angle, along = rng.uniform(*arc, count), rng.uniform(-0.5, 0.5, count) * length
    reach = radius + rng.normal(0, noise, count)
    local = np.stack([reach * np.cos(angle), reach * np.sin(angle), along], axis=1)
    return local @ frame + np.asarray(center, float)


def floor(rng, count, side, height=0.0, noise=0.0):
    """Points of a square in the plane z = height."""
    flat = rng.uniform(-side / 2, side / 2, (count, 2))
    return np.column_stack([flat, height + rng.normal(0, noise, count)])


def ball(rng, count, center, radius, noise=0.0):
    """Points on a ball."""
    way = rng.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return way * (radius + rng.normal(0, noise, (count, 1))) + np.asarray(center)
