"""A search of every n-th row and column tells of all pixels of the image."""

import numpy as np
import pytest

import impostor_jax as ij
from tests.fit.scenes import SIGMA, can
from tests.groups import SMALL_IMAGES

pytestmark = SMALL_IMAGES

# Odd, so that the last row and column stand alone.
CAMERA = ij.PinholeCamera(260.0, 260.0, 160.0, 120.0, 321, 241)


@pytest.mark.parametrize("stride", [1, 2])
def test_masks_are_of_the_image(stride):
    # With a stride of 2 they had the view's shape, and the search raised.
    truth = can(90.0)
    maps = ij.render(truth, CAMERA, outputs=("depth", "mask"))
    mask = np.asarray(maps.mask)
    wall = float(truth.center[2]) + 0.4
    noise = SIGMA * np.random.default_rng(0).normal(size=mask.shape)
    depth = np.where(mask, np.asarray(maps.depth), wall) + noise
    found = ij.find_cylinders(depth, CAMERA, SIGMA, effort=ij.Effort(stride=stride))
    assert found.masks.shape == (1, *mask.shape)
    union = found.masks[0] | mask
    # Of half of the rows and columns an outline is known to a pixel and a half.
    assert (found.masks[0] & mask).sum() > (0.97 if stride == 1 else 0.85) * union.sum()
    fit = found.fits[0]
    assert fit.cylinder.radius == pytest.approx(0.04, abs=4 * float(fit.std.radius))
