"""The published marches, which an experiment measures, do what is said of them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from experiments.marching_trade.march import MARCHES, March, difference_normal, march
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.primitives.terrain import Terrain

TERRAIN = Terrain(octaves=5)


def land():
    extent = ((-20.0, 20.0), (-20.0, 20.0))
    return ij.Heightfield(TERRAIN, extent, lipschitz=TERRAIN.lipschitz)


def rays_of(origin, direction):
    parts = (jnp.asarray(v, jnp.float32) for v in (origin, direction))
    return Ray(*(Vec3.from_array(part) for part in parts))


@pytest.mark.parametrize("settings", [*MARCHES.values(), March(factor=0.1, steps=256)])
def test_marching_stops_near_the_surface(settings):
    origin = [(x, 8.0, z) for x in (-5.0, 0.3, 7.0) for z in (-4.0, 2.0)]
    rays = rays_of(origin, [(0.2, -1.0, 0.1)] * 6)
    exact = jax.jit(lambda field: field.intersect(rays).t)(land())
    np.testing.assert_allclose(march(land(), rays, settings), exact, atol=0.05)


def test_normals_by_differences_approach_the_analytic_one():
    field = land()
    rays = rays_of([(0.3, 9.0, 0.2), (0, 9, 0)], [(0.1, -1, 0.3), (0, 1, 0)])
    hit = field.intersect(rays)
    exact = field.normal(rays, hit).stack()
    for epsilon in (0.02, 0.001 * hit.t * rays.direction.norm()):
        found = jax.jit(difference_normal)(field, rays, hit, epsilon).stack()
        np.testing.assert_allclose(found, exact, atol=2e-3)
        assert not np.asarray(found[1]).any()
