"""Areas and middles of the parts into which a line cuts a pixel."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.numerics import eps
from impostor_jax.rendering.half_pixels import halves, reach
from tests.checks import all_finite
from tests.groups import FULL

ANGLES = (0.0, 1e-9, 0.3, np.pi / 4, 1.2, np.pi / 2, 2.0, 3.5, 5.0)
DISTANCES = (-0.8, -0.6, -0.499, -0.2, 0.0, 0.1, 0.49, 0.55)


def lines(dtype):
    angle, s = (x.ravel() for x in np.meshgrid(ANGLES, DISTANCES))
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return jnp.asarray(s, dtype), jnp.asarray(normal, dtype)


@FULL
def test_parts_are_those_of_many_points(double):
    s, normal = lines(np.float64)
    found = jax.jit(halves)(s, normal)
    count = 1000
    place = (np.arange(count) + 0.5) / count - 0.5
    points = np.stack(np.meshgrid(place, place), axis=-1).reshape(-1, 2)
    for k in range(len(s)):
        first = points @ np.asarray(normal[k]) + float(s[k]) > 0
        # A line along a column takes all of its points, or none.
        assert first.mean() == pytest.approx(float(found.area[k]), abs=1.1 / count)
        for part, middle in zip((first, ~first), found.middles, strict=True):
            if part.mean() > 0.01:
                mean = points[part].mean(axis=0)
                np.testing.assert_allclose(middle[k], mean, atol=1.1 / count)


@jax.jit
def area_and_slope(s, normal):
    return jax.jvp(lambda s: halves(s, normal).area, (s,), (jnp.ones_like(s),))


@FULL
def test_slope_is_that_of_differences_and_finite():
    s, normal = lines(np.float32)
    # The corner is smooth, too: a step to either side sees the same formula but there.
    area, slope = area_and_slope(s, normal)
    assert all_finite((area, slope))
    assert (np.asarray(slope) >= 0).all()
    # All of it is crossed once.
    steps = jnp.linspace(-0.75, 0.75, 3001)
    for n in np.asarray(normal)[: len(ANGLES)]:
        _, grow = area_and_slope(steps, jnp.broadcast_to(n, (steps.size, 2)))
        assert float(jnp.sum(grow)) * 1.5 / 3000 == pytest.approx(1, abs=2e-3)


@FULL
def test_a_line_that_misses_cuts_nothing_off(dtype):
    s, normal = lines(dtype)
    far = jnp.where(s < 0, -1, 1) * (reach(normal) + eps(dtype, 8))
    found = halves(far.astype(s.dtype), normal)
    np.testing.assert_array_equal(found.area, np.asarray(s) >= 0)
    whole = jnp.where((s < 0)[:, None], found.middles[1], found.middles[0])
    np.testing.assert_array_equal(whole, 0)
