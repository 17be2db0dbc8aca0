"""Which pixels of a picture take one ray, several, or none of their own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.rendering.sampling import Sampling, picture_of
from tests.groups import FULL, RELEASE

pytestmark = FULL

HEIGHT, WIDTH = 21, 30
EDGE = 12.3
"""Column beyond which a picture is brighter by 100."""

CAMERA = ij.PinholeCamera(30.0, 30.0, 19.5, 14.5, 40, 30)


def see(row, col, places):
    """A ramp with a step, of which the trail tells the side."""
    x, y = (
        pixel[None].astype(float) + place[:, None]
        for pixel, place in ((col, places[:, 0]), (row, places[:, 1]))
    )
    is_beyond = x > EDGE
    color = Vec3(x + jnp.where(is_beyond, 100.0, 0.0), y, jnp.ones_like(x))
    return color, is_beyond.astype(jnp.int32)


def drawn(samples=1, adaptive=True, spacing=1):
    row, col = np.meshgrid(np.arange(HEIGHT), np.arange(WIDTH), indexing="ij")
    sampling = Sampling(samples, adaptive, spacing)
    color = picture_of(see, jnp.asarray(row), jnp.asarray(col), sampling)
    return np.asarray(color.stack()), row, col


def test_only_pixels_beside_another_trail_take_several_rays():
    one, row, col = drawn()
    found, all_of_them = drawn(4)[0], drawn(4, adaptive=False)[0]
    # Rays at 11.625 to 12.375, the last beyond the edge; their mean is at 12.
    np.testing.assert_allclose(all_of_them[:, 12, 0], 12 + 100 / 4)
    beside = (col == 12) | (col == 13)
    np.testing.assert_array_equal(found[beside], all_of_them[beside])
    np.testing.assert_array_equal(found[~beside], one[~beside])
    np.testing.assert_array_equal(one[..., 1], row)


@pytest.mark.parametrize("spacing", [2, 3, 4, 50])
def test_pixels_between_rays_of_one_trail_take_their_mean(spacing):
    found, (one, _, col) = drawn(spacing=spacing)[0], drawn()
    # A ramp is the mean of what is around, wherever it is.
    np.testing.assert_allclose(found, one, atol=1e-4)
    asked = []

    def counted(row, col, places):
        jax.debug.callback(lambda row: asked.append(row.size), row)
        return see(row, col, places)

    row, col = jnp.asarray(np.indices((HEIGHT, WIDTH)))
    jax.block_until_ready(
        picture_of(counted, row, col, Sampling(1, True, spacing)).stack()
    )
    jax.effects_barrier()
    grid = (-(-(HEIGHT - 1) // spacing) + 1) * (-(-(WIDTH - 1) // spacing) + 1)
    assert asked[0] == grid


@pytest.mark.parametrize("edges", ["hard", pytest.param("area", marks=RELEASE)])
def test_a_tile_is_a_block_of_the_picture(edges):
    # What is beyond its border tells whether a pixel there takes several rays.
    shapes = [ij.Sphere((0.1, 0.0, 2.0), 0.5), ij.Plane((0, 0.4, 0), (0, -1.0, 0))]
    given = (CAMERA, [ij.PointLight((0.5, -2.0, 0.5), 1.0)])
    how = {"effort": ij.Effort(samples=2), "edges": edges}
    whole = ij.trace(ij.Scene(shapes), *given, **how)
    for row, col in ((7, 9), (9, 12), (12, 17)):
        tile = ij.Tile(row=row, col=col, height=11, width=13)
        found = ij.trace(ij.Scene(shapes), *given, tile=tile, **how)
        block = whole[row : row + 11, col : col + 13]
        np.testing.assert_allclose(found, block, atol=1e-5)


def test_several_rays_are_a_picture_of_more_pixels():
    ball, light = ij.Sphere((0.1, 0.0, 2.0), 0.5), [ij.PointLight((0.5, -2, 0.5), 1.0)]
    fine = ij.PinholeCamera(90.0, 90.0, 59.5, 44.5, 120, 90)
    mean = np.asarray(ij.trace(ball, fine, light)).reshape(30, 3, 40, 3, 3)
    expected = mean.mean(axis=(1, 3))
    whole = ij.trace(ball, CAMERA, light, effort=ij.Effort(samples=3, adaptive=False))
    np.testing.assert_allclose(whole, expected, atol=1e-5)
    some = np.asarray(ij.trace(ball, CAMERA, light, effort=ij.Effort(samples=3)))
    once = np.asarray(ij.trace(ball, CAMERA, light))
    rmse = [np.sqrt(np.mean((x - expected) ** 2)) for x in (some, once)]
    assert rmse[0] < 0.1 * rmse[1]


@RELEASE
def test_a_picture_of_every_second_ray_has_a_derivative(double):
    def red(height, **dials):
        ball = ij.Sphere((0.1, 0.0, 2.0), 0.5)
        light = [ij.PointLight((0.5, height, 0.5), 1.0)]
        color = ij.trace(ball, CAMERA, light, effort=ij.Effort(**dials))
        return jnp.sum(color[10:20, 15:25])

    every, second = (jax.grad(lambda h, d=d: red(h, spacing=d))(-2.0) for d in (1, 2))
    # The shade is no straight line between two rays: here it differs by 1 %.
    assert float(second) == pytest.approx(float(every), rel=0.03)
    step = (red(-2.0 + 1e-5, spacing=2) - red(-2.0 - 1e-5, spacing=2)) / 2e-5
    assert float(second) == pytest.approx(float(step), rel=1e-5)
