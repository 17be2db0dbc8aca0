"""Blocks of pixels that a shape can cover, beside the ray of every pixel."""

import jax
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.rendering.touched import BLOCK
from tests.groups import FULL

# The last blocks reach beyond it.
HEIGHT, WIDTH = 4 * BLOCK[0] + 5, 2 * BLOCK[1] + 3

OUTPUTS = ("depth", "mask", "normal", "part")


@jax.jit
def every_ray(can, camera):
    """What is traced is rendered without blocks."""
    return ij.render(can, camera, OUTPUTS)


@FULL
@pytest.mark.parametrize(
    ("center", "radius", "share"),
    [
        pytest.param((0, 0, 1), 0.1, (0.01, 0.2), id="in the middle"),
        pytest.param((-0.65, -0.3, 1), 0.1, (0.005, 0.1), id="beyond the first corner"),
        pytest.param((0.6, 0.35, 1), 0.1, (0.005, 0.1), id="beyond the last corner"),
        pytest.param((2, 0, 1), 0.1, (0, 0), id="out of the image"),
        pytest.param((0, 0, -1), 0.1, (0, 0), id="behind the camera"),
        pytest.param((0, 0, 0.5), 0.45, (0.9, 1), id="close up"),
        pytest.param((0, 0, 0), 0.3, (1, 1), id="around the camera"),
    ],
)
def test_blocks_are_what_every_ray_sees(center, radius, share):
    camera = ij.PinholeCamera(200, 200, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT)
    can = ij.Cylinder(center, (0.3, 0.8, 0.52), radius, 3 * radius)
    found = jax.tree.map(np.asarray, ij.render(can, camera, OUTPUTS))
    expected = every_ray(can, camera)
    assert share[0] <= found.mask.mean() <= share[1]
    # A ray that grazes to rounding may be rounded to either side.
    apart = found.mask != expected.mask
    assert apart.sum() <= 2
    np.testing.assert_array_equal(found.part[~apart], expected.part[~apart])
    for name in ("depth", "normal"):
        one, other = (getattr(maps, name)[~apart] for maps in (found, expected))
        np.testing.assert_allclose(one, other, rtol=2e-6, atol=2e-5)
