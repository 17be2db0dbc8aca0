import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.numerics import eps
from impostor_jax.rendering.polygon import BLOCK, polygon_coverage, running_sum
from tests.checks import central_difference
from tests.rendering import exact

HEIGHT, WIDTH, COUNT = 9, 12, 160


class Frame:
    height, width = HEIGHT, WIDTH


def star(center=(5.3, 4.2), size=3.2, points=5, depth=0.3):
    """A curve that is not convex, counterclockwise with rows counting downwards."""
    angle = np.linspace(0, 2 * np.pi, COUNT, endpoint=False)
    radius = size * (1 + depth * np.cos(points * angle))
    return np.array(center) + np.stack(
        [radius * np.cos(angle), -radius * np.sin(angle)], axis=1
    )


def square(low=(2.0, 1.0), high=(8.0, 6.0)):
    """Sides along the pixels, and corners on whole coordinates."""
    t = np.linspace(0, 1, COUNT // 4, endpoint=False)[:, None]
    corners = np.array([(low[0], low[1]), (low[0], high[1]),
                        (high[0], high[1]), (high[0], low[1])])  # fmt: skip
    sides = zip(corners, np.roll(corners, -1, 0), strict=True)
    return np.concatenate([a + t * (b - a) for a, b in sides])


POLYGONS = {
    "star": star(),
    "beyond every side": star((5.0, 4.0), 7.0),
    "within a pixel": star((5.1, 4.2), 0.2),
    "thinner than a pixel": star((5, 4), 4.0, 2, 1.0) * [1, 0.02] + [0, 4.1],
    "along pixel centers": square(),
    "along pixel sides": square((1.5, 0.5), (7.5, 6.5)),
    "out of sight": star((-30.0, 4.0)),
}


@jax.jit
def areas(vertices):
    return polygon_coverage(vertices, HEIGHT, WIDTH)


@jax.jit
def sum_and_slope(vertices, weights):
    return jax.value_and_grad(lambda v: jnp.sum(weights * areas(v)))(vertices)


@pytest.mark.parametrize("name", POLYGONS)
def test_areas_are_those_of_clipping(name, dtype):
    polygon = POLYGONS[name]
    covered = areas(jnp.asarray(polygon, dtype))
    expected = exact.coverage(polygon, Frame)
    np.testing.assert_allclose(covered, expected, atol=eps(dtype, 256))
    # Pixels without an edge are exactly full or empty.
    assert set(np.asarray(covered)[np.isin(expected, (0, 1))]) <= {0, 1}


@pytest.mark.usefixtures("double")
def test_derivative_is_what_the_edges_sweep_over():
    rng = np.random.default_rng(0)
    weights = jnp.asarray(rng.normal(size=(HEIGHT, WIDTH)))
    for name in ("star", "beyond every side", "within a pixel"):
        vertices = jnp.asarray(POLYGONS[name])
        shift = jnp.asarray(rng.normal(size=vertices.shape))
        slope = float(jnp.sum(sum_and_slope(vertices, weights)[1] * shift))
        numeric = central_difference(
            lambda v: sum_and_slope(v, weights)[0], vertices, shift
        )
        assert slope == pytest.approx(float(numeric), rel=1e-6)


@pytest.mark.usefixtures("double")
def test_derivative_of_an_edge_along_a_pixel_side_is_finite():
    weights = jnp.ones((HEIGHT, WIDTH))
    _, slope = sum_and_slope(jnp.asarray(POLYGONS["along pixel sides"]), weights)
    assert np.isfinite(slope).all()
    # Its left side moves by one pixel, and sweeps over what lies in the image.
    left = jnp.asarray(POLYGONS["along pixel sides"])[:, 0] == 1.5
    assert float(jnp.sum(jnp.where(left, slope[:, 0], 0))) == pytest.approx(-6.0, 0.03)


@pytest.mark.parametrize("length", [1, BLOCK, 3 * BLOCK + 5])
def test_running_sum_is_a_cumulative_sum(length, dtype):
    values = np.random.default_rng(0).normal(size=(3, length)).astype(dtype)
    found = jax.jit(running_sum)(jnp.asarray(values))
    np.testing.assert_allclose(found, np.cumsum(values, 1), atol=eps(dtype, 256))
