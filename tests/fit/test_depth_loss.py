"""Losses of a rendered depth whose gradient is finite, whatever the target holds."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.robust import KERNELS
from tests.checks import all_finite
from tests.fit.scenes import CAMERA, SIGMA, can
from tests.groups import FULL

TRUTH = can()
START = ij.Cylinder((0.02, 0.0, 0.36), TRUTH.axis, 0.036, 0.12)


def target(missing):
    """Depth with what a missing reading holds, and with one that is far too large."""
    maps = ij.render(TRUTH, CAMERA)
    depth = np.where(np.asarray(maps.mask), np.asarray(maps.depth), missing)
    depth[60, 84] = missing
    depth[60, 85] = 1e38
    return depth


@FULL
@pytest.mark.parametrize("missing", [0.0, np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("kernel", KERNELS)
def test_gradient_is_finite_whatever_marks_a_missing_reading(missing, kernel):
    def loss(shape, depth):
        return ij.depth_loss(ij.render(shape, CAMERA), depth, kernel=kernel)

    both = jax.jit(jax.value_and_grad(loss, argnums=(0, 1)))
    value, gradients = both(START, target(missing))
    assert np.isfinite(float(value))
    assert all_finite(gradients)
    assert float(jnp.abs(gradients[0].center).max()) > 0


def test_loss_of_noise_alone_is_about_one():
    maps = ij.render(TRUTH, CAMERA)
    noise = np.random.default_rng(0).normal(0, SIGMA, maps.depth.shape)
    depth = np.asarray(maps.depth) + noise
    loss = ij.depth_loss(maps, depth, sigma=SIGMA, kernel="squares")
    # Of 2000 squares whose deviation is the root of two.
    assert float(loss) == pytest.approx(1, abs=4 * np.sqrt(2 / 2000))
    assert float(ij.depth_loss(maps, maps)) == 0


def test_mask_says_which_pixels_count():
    maps = ij.render(TRUTH, CAMERA)
    is_left = np.broadcast_to(np.arange(160) < 84, (120, 160))
    wrong = np.asarray(maps.depth) + np.where(is_left, 0.01, 0)
    assert float(ij.depth_loss(maps, wrong)) > 1
    assert float(ij.depth_loss(maps, wrong, mask=~is_left)) == 0
    none = ij.depth_loss(maps, wrong, mask=np.zeros(wrong.shape, bool))
    assert float(none) == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"target": np.ones((9, 9))},
            "target must have the shape of the maps",
        ),
        ({"target": np.ones((120, 160), int)}, "target must be floating-point meters"),
        ({"target": ij.GeometryMaps()}, "target must hold the depth: ask render"),
        ({"mask": np.ones((120, 160))}, "mask must be of booleans of the shape"),
        ({"sigma": 0}, "sigma must be a positive number in meters"),
        ({"kernel": "huber"}, "kernel must be one of pseudo_huber, cauchy"),
    ],
)
def test_bad_argument_is_refused(arguments, message):
    maps = ij.render(TRUTH, CAMERA)
    with pytest.raises(ValueError, match=message):
        ij.depth_loss(**{"maps": maps, "target": maps, **arguments})


def natural(shape, depth, mask, miss):
    maps = ij.render(shape, CAMERA, miss=miss)
    return jnp.where(maps.mask & mask, (maps.depth - depth) ** 2, 0).sum()


def test_natural_loss_of_maps_without_infinity_has_a_finite_gradient():
    # With infinity in the target, inf * 0 made it NaN.
    seen = ij.render(TRUTH, CAMERA, miss=0.0)
    value, gradient = jax.value_and_grad(natural)(START, seen.depth, seen.mask, 0.0)
    assert float(value) > 0
    assert all_finite(gradient)
    step = jax.jvp(lambda s: natural(s, seen.depth, seen.mask, 0.0), (START,), (START,))
    assert np.isfinite(float(step[1]))


@pytest.mark.parametrize("effort", ["balanced", ij.Effort(extent="tile")])
def test_a_miss_is_the_number_that_is_asked_for(effort):
    outputs = ("depth", "range", "point", "normal", "mask")
    plain = ij.render(TRUTH, CAMERA, outputs, effort=effort)
    maps = ij.render(TRUTH, CAMERA, outputs, effort=effort, miss=-1.0)
    mask = np.asarray(maps.mask)
    for name in outputs:
        values, expected = np.asarray(getattr(maps, name)), getattr(plain, name)
        np.testing.assert_array_equal(values[mask], np.asarray(expected)[mask])
    for values in (maps.depth, maps.range, maps.point):
        assert (np.asarray(values)[~mask] == -1).all()
    assert not np.asarray(maps.normal)[~mask].any()
    with pytest.raises(ValueError, match="miss must be a finite number in meters"):
        ij.render(TRUTH, CAMERA, miss=float("nan"))
