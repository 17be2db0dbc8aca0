import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.geometry.rays import Ray, slab_interval, wall_interval
from impostor_jax.geometry.vec3 import Vec3


def vec(*components, dtype):
    return Vec3(*(jnp.asarray(c, dtype) for c in components))


@pytest.mark.parametrize(
    ("origin", "direction", "lower", "upper"),
    [
        pytest.param((-3, 0, 0), (1, 0, 0), 2.0, 4.0, id="across, through the axis"),
        pytest.param((-3, 0, 0), (2, 0, 0), 1.0, 2.0, id="direction of length 2"),
        pytest.param((-3, 2, 0), (1, 0, 0), np.inf, -np.inf, id="misses"),
        pytest.param((0.5, 0, 0), (0, 0, 1), -np.inf, np.inf, id="along, inside"),
        pytest.param((1.5, 0, 0), (0, 0, 1), np.inf, -np.inf, id="along, outside"),
    ],
)
def test_interval_in_a_unit_wall_along_z(origin, direction, lower, upper, dtype):
    ray = Ray(vec(*origin, dtype=dtype), vec(*direction, dtype=dtype))
    found = wall_interval(ray, vec(0, 0, 1, dtype=dtype), jnp.ones((), dtype))
    assert (float(found.lower), float(found.upper)) == (lower, upper)


@pytest.mark.parametrize(
    ("origin", "direction", "lower", "upper"),
    [
        pytest.param((0, 0, -3), (0, 0, 1), 2.0, 4.0, id="along the axis"),
        pytest.param((0, 0, 3), (0, 0, -1), 2.0, 4.0, id="from the other side"),
        pytest.param((5, 0, 0.5), (1, 0, 0), -np.inf, np.inf, id="parallel, inside"),
        pytest.param((5, 0, 1.0), (1, 0, 0), -np.inf, np.inf, id="parallel, in a face"),
        pytest.param((5, 0, 1.5), (1, 0, 0), np.inf, -np.inf, id="parallel, outside"),
    ],
)
def test_interval_in_a_slab_across_z(origin, direction, lower, upper, dtype):
    ray = Ray(vec(*origin, dtype=dtype), vec(*direction, dtype=dtype))
    found = slab_interval(ray, vec(0, 0, 1, dtype=dtype), jnp.ones((), dtype))
    assert (float(found.lower), float(found.upper)) == (lower, upper)


def test_recentered_ray_passes_through_the_same_points(dtype):
    ray = Ray(vec(1, 2, 3, dtype=dtype), vec(0.5, -1, 2, dtype=dtype))
    center = vec(4, 4, 4, dtype=dtype)
    local, foot = ray.recentered(center)
    assert float(local.origin.dot(ray.direction)) == pytest.approx(0, abs=1e-5)
    back = local.at(jnp.asarray(1.5, dtype) - foot) + center
    np.testing.assert_allclose(
        back.stack(), ray.at(jnp.asarray(1.5, dtype)).stack(), rtol=1e-6
    )
