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


@pytest.mark.parametrize(
    ("start", "moves"),
    [pytest.param(-9.0, True, id="afar"), pytest.param(1.0, False, id="near")],
)
def test_ray_brought_near_passes_through_the_same_points(start, moves, dtype):
    direction, center = vec(0.5, -1, 2, dtype=dtype), vec(4, 4, 4, dtype=dtype)
    ray = Ray(vec(3.9, 4.2, 4, dtype=dtype) + direction * start, direction)
    near, foot = ray.brought_near(center, center, jnp.ones((), dtype))
    assert (float(foot) > 0) == moves
    if moves:
        assert float(near.origin.dot(direction)) == pytest.approx(0, abs=1e-5)
    back = near.at(jnp.asarray(1.5, dtype) - foot) + center
    np.testing.assert_allclose(
        back.stack(), ray.at(jnp.asarray(1.5, dtype)).stack(), rtol=1e-6
    )
