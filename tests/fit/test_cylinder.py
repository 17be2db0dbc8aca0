import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from experiments import scenes
from impostor_jax.geometry.so3 import tangent_basis
from tests.cases import pose
from tests.checks import all_finite, angle_between
from tests.fit.scenes import CAMERA, SIGMA, camera_with, can, image, image_of
from tests.groups import FULL, RELEASE, SMALL_IMAGES

pytestmark = SMALL_IMAGES


def across(fit, truth):
    """Distance of the centers across the true axis, in meters."""
    axis = np.asarray(truth.axis, float)
    offset = np.asarray(fit.cylinder.center, float) - np.asarray(truth.center, float)
    return np.linalg.norm(offset - offset @ axis * axis)


def test_heights_along_rows_and_columns_err_by_what_they_say():
    """All rows show an end that runs along columns in the same place."""
    scores = []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        center = (*rng.uniform(-0.01, 0.01, 2), 0.35)
        sizes = rng.uniform(0.02, 0.04), rng.uniform(0.08, 0.16)
        truth = ij.Cylinder(center, [(1, 0, 0), (0, 1, 0)][seed % 2], *sizes)
        depth, mask = image_of(truth, seed=seed)
        fit = ij.fit_cylinder(depth, CAMERA, mask, SIGMA)
        assert fit.success
        off = float(fit.cylinder.height - truth.height)
        scores.append(off / float(fit.std.height))
    # Each row as a place of its own, they were off by 1.9 deviations and up to 4.5.
    assert np.abs(scores).max() < 3
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 1.3


@pytest.mark.parametrize("masked", [True, False], ids=["mask", "no mask"])
@pytest.mark.parametrize("degrees", [90.0, 60.0, 30.0])
def test_noisy_can_is_recovered(degrees, masked):
    depth, mask = image(degrees)
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask if masked else None, sigma=SIGMA)
    truth = can(degrees)
    assert fit.success
    assert fit.status is ij.FitStatus.CONVERGED
    assert fit.cylinder.radius == pytest.approx(0.04, abs=1e-4)
    assert angle_between(fit.cylinder.axis, truth.axis) < 0.15
    assert across(fit, truth) < 1.5e-4
    # Both ends are seen; a pixel is 2.3 mm wide here, and 4.7 mm along an axis at 30
    # degrees.
    assert fit.height_observed
    assert float(fit.std.height) < 1e-3
    assert fit.cylinder.height == pytest.approx(0.12, abs=4 * float(fit.std.height))
    assert fit.rms == pytest.approx(SIGMA, rel=0.05)
    union = np.asarray(fit.region) | mask
    assert (np.asarray(fit.region) & mask).sum() > 0.97 * union.sum()


def test_errors_are_within_four_reported_deviations():
    truth = can()
    scores = []
    for seed in range(16):
        depth, mask = image(seed=seed)
        fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
        offset = np.asarray(fit.cylinder.center - truth.center)
        basis = np.asarray(tangent_basis(fit.cylinder.axis))
        scores += [*(basis @ offset / np.asarray(fit.std.across_axis))]
        scores += [float((fit.cylinder.radius - 0.04) / fit.std.radius)]
    # 48 draws, partly correlated: their own deviation is known to about 15 percent.
    assert np.abs(scores).max() < 4
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.4


def test_result_has_the_promised_shapes_and_sign():
    depth, mask = image()
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    axis = np.asarray(fit.cylinder.axis)
    assert np.linalg.norm(axis) == pytest.approx(1, abs=1e-6)
    assert axis[np.argmax(np.abs(axis))] > 0
    shapes = {"center": (3,), "across_axis": (2,), "axis": (2,), "radius": ()}
    for name, shape in shapes.items():
        assert getattr(fit.std, name).shape == shape
    assert fit.residual.shape == fit.inliers.shape == mask.shape
    assert int(fit.num_pixels) == mask.sum()
    assert str(fit.status) == "converged"
    assert 3 <= int(fit.num_steps) < 60


def test_the_same_image_gives_the_same_result():
    depth, _ = image()
    first, again = (ij.fit_cylinder(depth, CAMERA, sigma=SIGMA) for _ in range(2))
    for one, other in zip(jax.tree.leaves(first), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(one, other)


def test_rendered_depth_fits_as_it_is():
    truth = can()
    maps = ij.render(truth, CAMERA)
    fit = ij.fit_cylinder(maps.depth, CAMERA)
    assert fit.success
    assert fit.cylinder.radius == pytest.approx(0.04, abs=5e-5)
    assert angle_between(fit.cylinder.axis, truth.axis) < 0.05


def test_end_without_background_is_not_observed():
    depth, mask = image(wall=None)
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    assert fit.success
    # The cap that faces the camera is seen, the other end is not.
    assert np.asarray(fit.ends_seen).sum() == 1
    assert not fit.height_observed
    assert np.isposinf(fit.std.height)
    assert np.isposinf(np.asarray(fit.std.center)).all()
    assert np.isfinite(np.asarray(fit.std.across_axis)).all()
    assert 0.1 < float(fit.cylinder.height) < 0.122


def test_part_of_the_wall_alone_leaves_the_height_open():
    depth, mask = image(90.0)
    rows, _ = np.nonzero(mask)
    part = mask.copy()
    part[: int(np.percentile(rows, 30))] = False
    part[int(np.percentile(rows, 70)) :] = False
    fit = ij.fit_cylinder(depth, CAMERA, mask=part, sigma=SIGMA)
    assert fit.success
    assert not np.asarray(fit.ends_seen).any()
    assert np.isposinf(fit.std.height)
    assert float(fit.cylinder.height) < 0.12
    assert fit.cylinder.radius == pytest.approx(0.04, abs=5e-4)


def test_steep_view_with_noise_is_recovered_from_a_later_first_guess():
    # Its first guess is an axis across the true one: a success that was 89 degrees off.
    truth = ij.Cylinder((0.02, 0.01, 0.8), (0.104, 0.139, 0.985), 0.04, 0.12)
    camera = ij.PinholeCamera(440.0, 440.0, 79.5, 59.5, 160, 120)
    maps = ij.render(truth, camera)
    noise = np.random.default_rng(0).normal(0, 0.003, maps.depth.shape)
    depth = (np.asarray(maps.depth) + noise).astype(np.float32)
    fit = ij.fit_cylinder(depth, camera, mask=maps.mask, sigma=0.003)
    assert fit.success
    assert angle_between(fit.cylinder.axis, truth.axis) < 0.5


def test_an_occluder_in_front_does_not_end_the_wall():
    depth, mask = image(90.0)
    rows, _ = np.nonzero(mask)
    hidden = np.zeros_like(mask)
    hidden[int(np.percentile(rows, 80)) :] = True
    depth = np.where(hidden, 0.2, depth).astype(np.float32)
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask & ~hidden, sigma=SIGMA)
    assert fit.success
    assert np.asarray(fit.ends_seen).sum() == 1
    assert np.isposinf(fit.std.height)


def test_one_tenth_of_outliers_is_borne():
    depth, mask = image()
    rng = np.random.default_rng(5)
    wrong = rng.random(depth.shape) < 0.1
    depth = np.where(wrong, rng.uniform(0.2, 1.0, depth.shape), depth)
    fit = ij.fit_cylinder(depth.astype(np.float32), CAMERA, mask=mask, sigma=SIGMA)
    assert fit.success
    assert fit.cylinder.radius == pytest.approx(0.04, abs=3e-4)
    assert not (np.asarray(fit.inliers) & wrong).sum() > 0.1 * wrong[mask].sum()


def test_fixed_parameters_keep_their_value_and_have_no_deviation():
    depth, mask = image()
    start = ij.Cylinder(can().center, can().axis, radius=0.04001, height=0.12)
    fit = ij.fit_cylinder(
        depth, CAMERA, mask=mask, sigma=SIGMA, initial=start, fixed=("radius", "height")
    )
    assert float(fit.cylinder.radius) == pytest.approx(0.04001, rel=1e-6)
    assert float(fit.std.radius) == 0
    assert angle_between(fit.cylinder.axis, can().axis) < 0.15


def test_held_height_stays_where_an_end_is_not_seen():
    depth, mask = image(wall=None)
    fit = ij.fit_cylinder(
        depth, CAMERA, mask=mask, sigma=SIGMA, initial=can(), fixed=("height", "radius")
    )
    assert float(fit.cylinder.height) == pytest.approx(0.12, rel=1e-6)
    assert float(fit.std.height) == 0
    # The cap that is seen tells where the whole cylinder is.
    assert np.isfinite(np.asarray(fit.std.center)).all()
    np.testing.assert_allclose(fit.cylinder.center, can().center, atol=5e-4)


@FULL
def test_traced_fit_agrees_with_the_plain_one():
    depth, mask = image()
    start = can()
    # Both as near to their fixed point as a fit goes that is differentiated.
    given = {"sigma": SIGMA, "initial": start, "effort": ij.Effort(tolerance=0.02)}
    plain = ij.fit_cylinder(depth, CAMERA, mask=mask, **given)

    @jax.jit
    def fit(depths):
        return jax.vmap(
            lambda depth: ij.fit_cylinder(depth, CAMERA, mask=mask, **given)
        )(depths)

    both = fit(jnp.stack([jnp.asarray(depth), jnp.asarray(image(seed=1)[0])]))
    assert np.asarray(both.success).all()
    radius = float(plain.cylinder.radius)
    assert float(both.cylinder.radius[0]) == pytest.approx(radius, abs=1e-6)
    assert float(both.cylinder.radius[1]) != float(both.cylinder.radius[0])
    assert all_finite(both.cylinder)


def plane_image():
    row, col = np.mgrid[0:120, 0:160]
    depth = 0.5 / (1 + 0.002 * (col - 80) + 0.001 * (row - 60))
    return depth + np.random.default_rng(0).normal(0, SIGMA, depth.shape)


def box_image():
    row, col = np.mgrid[0:120, 0:160]
    return 0.5 + 0.002 * np.abs(col - 80) + 0.001 * np.abs(row - 60)


@FULL
@pytest.mark.parametrize("make", [plane_image, box_image])
def test_what_is_no_cylinder_fails_with_a_reason(make):
    depth = make().astype(np.float32)
    mask = np.zeros(depth.shape, bool)
    mask[40:80, 55:105] = True
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    assert not fit.success
    assert fit.status in {
        ij.FitStatus.POOR_FIT,
        ij.FitStatus.UNDETERMINED,
        ij.FitStatus.NO_FIRST_GUESS,
        ij.FitStatus.STEP_LIMIT,
    }
    assert fit.status.meaning
    for leaf in jax.tree.leaves(fit.std):
        assert np.isposinf(np.asarray(leaf)).all()


DEPTH, MASK = image()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"depth": DEPTH[:-1]}, r"depth must have the camera's shape \(120, 160\)"),
        ({"depth": DEPTH.astype(np.uint16)}, "depth must be floating-point meters"),
        ({"depth": -DEPTH}, "depth must not be negative"),
        ({"depth": "depth.png"}, "must be an array, got the text 'depth.png': read"),
        ({"depth": Path("a.npy")}, "must be an array, got the text 'a.npy': read"),
        ({"depth": DEPTH.tolist()}, r"got a list of list: np.asarray\(depth\)"),
        ({"mask": "mask.png"}, "mask must be an array, got the text 'mask.png': read"),
        ({"mask": MASK.tolist()}, r"or np.asarray\(mask\) of lists of numbers"),
        ({"camera": ()}, "camera must be a camera, got tuple; ij.camera_from makes"),
        ({"sigma": "stereo"}, "such as ij.StructuredLight.*, got the text 'stereo'"),
        ({"sigma": ij.StructuredLight}, "got the class StructuredLight, of which an"),
        ({"sigma": ij.StructuredLight.sensor}, "function sensor, whose result is"),
        ({"sigma": np.full(9, 0.001)}, r"sigma must be .* shape \(120, 160\), got"),
        ({"depth": 0 * DEPTH, "mask": None}, "at least 50 readings, got 0"),
        ({"mask": MASK[:, :-1]}, r"mask must have the camera's shape \(120, 160\)"),
        ({"mask": MASK * 1.0}, "mask must be of booleans or integers, got float64"),
        ({"mask": MASK & False}, "mask must hold at least one pixel"),
        ({"mask": np.eye(120, 160, dtype=int)[::-1] * MASK}, "inside the mask"),
        ({"sigma": 0}, "sigma must be a positive number in meters, got 0"),
        ({"sigma": np.nan}, "sigma must be a positive number in meters, got nan"),
        ({"fixed": ("size",)}, "fixed must be one of center, axis, radius, height"),
        ({"fixed": "radius"}, "fixed must be a sequence of names"),
        ({"fixed": ("radius",)}, "initial must be given with fixed="),
        ({"effort": "slow"}, "effort must be an Effort or one of fast, balanced"),
        ({"prior": {"size": (1, 1)}}, "prior must be one of center, axis"),
        ({"prior": {"radius": 0.04}}, "must be a value and a standard deviation"),
        ({"prior": {"radius": (0.04, 0)}}, "deviation of prior.* must be a positive"),
    ],
)  # fmt: skip
def test_bad_argument_is_refused(arguments, message):
    given = {"depth": DEPTH, "camera": CAMERA, "mask": MASK, **arguments}
    with pytest.raises(ValueError, match=message):
        ij.fit_cylinder(**given)


def test_traced_fit_without_a_start_is_refused():
    with pytest.raises(ValueError, match="initial must be given to a traced fit"):
        jax.jit(lambda depth: ij.fit_cylinder(depth, CAMERA).rms)(DEPTH)


def test_several_starts_are_solved_and_their_agreement_is_reported():
    depth, mask = image()
    effort = ij.Effort(all_starts=True)
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA, effort=effort)
    assert int(fit.num_starts) > 1
    assert 1 <= int(fit.num_agreeing) <= int(fit.num_starts)
    given = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA, initial=can())
    assert int(given.num_starts) == int(given.num_agreeing) == 1
    # The answer does not hang on the start.
    assert float(given.cylinder.radius) == pytest.approx(
        float(fit.cylinder.radius), abs=float(fit.std.radius) / 10
    )


def test_tilt_that_noise_hides_is_found():
    # A tenth of the radius of noise: what the starts find is tilted by 15 degrees, and
    # only the whole image tells that another start was right.
    angle = np.radians(80)
    axis = (0.7 * np.sin(angle), 0.714 * np.sin(angle), np.cos(angle))
    truth = ij.Cylinder((0.02, -0.01, 0.8), axis, radius=0.08, height=0.08)
    maps = ij.render(truth, CAMERA, outputs=("depth", "mask"))
    mask = np.asarray(maps.mask)
    noise = np.random.default_rng(0).normal(0, 0.008, mask.shape)
    depth = (np.where(mask, maps.depth, 1.5) + noise).astype(np.float32)
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=0.008)
    assert fit.success
    assert angle_between(fit.cylinder.axis, truth.axis) < 1.0
    assert fit.cylinder.radius == pytest.approx(0.08, abs=4 * float(fit.std.radius))


def test_axis_of_a_short_can_that_noise_hides_is_not_across_it():
    # A fifth of the radius of noise, and nothing behind: no guess led to the truth, and
    # a can turned by 86 degrees was called a success.
    truth = ij.Cylinder((0.01, 0.005, 0.5), (0.6, 0.8, 0.1), radius=0.04, height=0.05)
    maps = ij.render(truth, CAMERA, outputs=("depth", "mask"))
    mask = np.asarray(maps.mask)
    noise = np.random.default_rng(37).normal(0, 0.008, mask.shape)
    depth = np.where(mask, maps.depth + noise, 0).astype(np.float32)
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=0.008)
    assert fit.success
    assert angle_between(fit.cylinder.axis, truth.axis) < 10
    assert fit.cylinder.radius == pytest.approx(0.04, abs=4 * float(fit.std.radius))


def test_covariance_holds_the_deviations():
    depth, mask = image()
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    variance = np.diagonal(np.asarray(fit.covariance))
    named = [*fit.std.axis, *fit.std.across_axis, fit.std.radius, fit.std.height]
    np.testing.assert_allclose(np.sqrt(variance[[0, 1, 2, 3, 5, 6]]), named, rtol=1e-4)
    assert np.asarray(fit.observed.coordinates).all()
    vectors = np.asarray(fit.observed.vector)
    np.testing.assert_allclose(vectors @ vectors.T, np.eye(7), atol=1e-4)
    assert (np.diff(np.asarray(fit.observed.deviation)) <= 0).all()


def test_slide_along_the_axis_is_named_as_what_the_image_leaves_free():
    depth, mask = image(wall=None)
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    assert np.asarray(fit.observed.coordinates).tolist() == [True] * 4 + [
        False,
        True,
        False,
    ]
    assert np.isposinf(np.asarray(fit.observed.deviation)[:2]).all()
    assert np.isposinf(np.asarray(fit.covariance)[4, 4])


def test_disc_is_fitted():
    coin = ij.Cylinder((0.01, 0.005, 0.35), (0.3, 0.5, 0.8), radius=0.06, height=0.015)
    maps = ij.render(coin, CAMERA)
    rng = np.random.default_rng(0)
    depth = np.minimum(np.asarray(maps.depth), 0.6) + rng.normal(0, SIGMA, (120, 160))
    fit = ij.fit_cylinder(depth.astype(np.float32), CAMERA, mask=maps.mask, sigma=SIGMA)
    assert fit.success
    assert fit.cylinder.radius == pytest.approx(0.06, abs=3e-4)
    assert angle_between(fit.cylinder.axis, coin.axis) < 0.5
    assert fit.cylinder.height == pytest.approx(0.015, abs=1e-3)


def test_pipe_is_fitted_from_inside():
    pipe = ij.Cylinder((0.02, 0.01, 0.6), (0.1, 0.15, 0.98), radius=0.2, height=2.0)
    maps = ij.render(pipe, CAMERA)
    assert np.asarray(maps.mask).all()
    depth = np.asarray(maps.depth)
    # The far cap is an opening, and the part around it tells all.
    wall = (depth > 1.0) & (depth < 1.5)
    rng = np.random.default_rng(0)
    depth = np.where(wall, depth + rng.normal(0, SIGMA, depth.shape), 0)
    fit = ij.fit_cylinder(depth.astype(np.float32), CAMERA, mask=wall, sigma=SIGMA)
    assert fit.success
    assert fit.cylinder.radius == pytest.approx(0.2, abs=5e-4)
    assert angle_between(fit.cylinder.axis, pipe.axis) < 0.2


# Options other than the usual, together, since each choice of them is compiled anew.
OTHER_OPTIONS = {
    "effort": ij.Effort(kernel="cauchy"),
    "scale": "fixed",
    "errors": "correlated",
    "mask_meaning": "outline",
}


@RELEASE
def test_another_kernel_bears_outliers():
    depth, mask = image()
    rng = np.random.default_rng(5)
    wrong = rng.random(depth.shape) < 0.1
    depth = np.where(wrong, rng.uniform(0.2, 1.0, depth.shape), depth)
    fit = ij.fit_cylinder(
        depth.astype(np.float32), CAMERA, mask=mask, sigma=SIGMA, **OTHER_OPTIONS
    )
    assert fit.success
    assert fit.cylinder.radius == pytest.approx(0.04, abs=5e-4)


@FULL
def test_outline_of_the_mask_shows_an_end_without_background():
    depth, mask = image(wall=None)
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA, **OTHER_OPTIONS)
    assert fit.success
    assert fit.height_observed
    # A quarter of a pixel, which is 2.3 mm wide here.
    assert fit.cylinder.height == pytest.approx(0.12, abs=6e-4)


@FULL
def test_correlated_errors_widen_the_deviations():
    _, mask = image()
    rng = np.random.default_rng(0)
    white = rng.normal(0, SIGMA, (122, 162))
    windows = np.lib.stride_tricks.sliding_window_view(white, (3, 3))
    maps = ij.render(can(), CAMERA)
    depth = np.minimum(np.asarray(maps.depth), 0.6) + windows.sum(axis=(2, 3)) / 3
    ratios = []
    for options in ({"errors": "independent"}, OTHER_OPTIONS):
        fit = ij.fit_cylinder(
            depth.astype(np.float32), CAMERA, mask=mask, sigma=SIGMA, **options
        )
        assert fit.success
        # Errors that neighbors share, and nobody tells, look like departures, too.
        of_form = np.asarray(fit.std_budget["form"].across_axis)
        ratios.append(np.sqrt(np.asarray(fit.std.across_axis) ** 2 - of_form**2))
    # Nine pixels share their error, so a mean has up to three times the deviation.
    assert (ratios[1] > 1.5 * ratios[0]).all()
    assert (ratios[1] < 4 * ratios[0]).all()


# A camera with a pose, and what is as good as unknown: a fit is compiled anew for the
# first, and for the names that its prior has.
POSED = camera_with(camera_from_world=pose())
VAGUE = {"radius": (0.04, 1.0), "height": (0.12, 1.0)}


def test_a_posed_camera_gives_the_cylinder_in_the_world():
    depth, mask = image()
    plain = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    fit = ij.fit_cylinder(depth, POSED, mask=mask, sigma=SIGMA, prior=VAGUE)
    expected = plain.cylinder.transformed(pose().inverse())
    np.testing.assert_allclose(fit.cylinder.center, expected.center, atol=2e-5)
    assert angle_between(fit.cylinder.axis, expected.axis) < 0.01
    assert float(fit.std.radius) == pytest.approx(float(plain.std.radius), rel=0.02)


def test_prior_counts_as_a_reading_of_its_deviation():
    depth, mask = image()
    free = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    deviation = float(free.std.radius)
    expected = float(free.cylinder.radius) + deviation
    belief = VAGUE | {"radius": (expected, deviation)}
    both = ij.fit_cylinder(depth, POSED, mask=mask, sigma=SIGMA, prior=belief)
    # Two equally sure witnesses meet in the middle.
    moved = float(both.cylinder.radius - free.cylinder.radius)
    assert moved == pytest.approx(deviation / 2, rel=0.3)
    assert float(both.std.radius) == pytest.approx(deviation / 2**0.5, rel=0.1)


def test_prior_on_the_height_places_an_end_that_is_not_seen():
    depth, mask = image(wall=None)
    belief = VAGUE | {"height": (0.12, 0.001)}
    fit = ij.fit_cylinder(depth, POSED, mask=mask, sigma=SIGMA, prior=belief)
    assert fit.cylinder.height == pytest.approx(0.12, abs=1e-4)
    assert float(fit.std.height) == pytest.approx(0.001, rel=0.1)
    expected = can().transformed(pose().inverse())
    np.testing.assert_allclose(fit.cylinder.center, expected.center, atol=1e-3)


def test_noise_model_is_as_good_as_its_number():
    depth, mask = image()
    number = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    model = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=ij.ConstantNoise(SIGMA))
    assert float(model.cylinder.radius) == float(number.cylinder.radius)


def test_batch_gives_each_image_its_own_fit_and_status():
    first, mask = image()
    second, _ = image(seed=1)
    wall = np.full_like(first, 0.5)
    fits = ij.fit_cylinders(
        np.stack([first, wall, second]), CAMERA, np.stack([mask] * 3), sigma=SIGMA
    )
    assert np.asarray(fits.success).tolist() == [True, False, True]
    for index, depth in ((0, first), (2, second)):
        alone = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
        assert float(fits.cylinder.radius[index]) == pytest.approx(
            float(alone.cylinder.radius), abs=float(alone.std.radius) / 10
        )
    assert np.isposinf(np.asarray(fits.std.radius)[1])


def test_an_image_that_cannot_be_fitted_fails_alone():
    depth, mask = image()
    depths = np.stack([np.zeros_like(depth), depth, -depth, depth])
    masks = [mask, mask & False, mask, mask]
    fits = ij.fit_cylinders(depths, CAMERA, masks, sigma=SIGMA)
    assert np.asarray(fits.success).tolist() == [False, False, False, True]
    assert {*fits.statuses[:3]} == {ij.FitStatus.NO_FIRST_GUESS}
    said = ("readings", "at least one pixel", "Depth must not be negative, got -")
    for reason, part in zip(fits.reasons, said, strict=False):
        assert part in reason
    alone = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    for one, all_ in zip(jax.tree.leaves(alone), jax.tree.leaves(fits), strict=True):
        assert (all_.shape, all_.dtype) == ((4, *one.shape), one.dtype)
    with pytest.raises(ValueError, match="depths must be of one size, got"):
        ij.fit_cylinders([depth, depth[1:]], CAMERA, sigma=SIGMA)


def test_each_image_of_a_batch_may_have_its_own_camera():
    depth, mask = image()
    fits = ij.fit_cylinders(
        np.stack([depth, depth]), [CAMERA, POSED], [mask, mask], sigma=SIGMA
    )
    assert np.asarray(fits.success).all()
    expected = can().transformed(pose().inverse())
    np.testing.assert_allclose(fits.cylinder.center[0], can().center, atol=1e-3)
    np.testing.assert_allclose(fits.cylinder.center[1], expected.center, atol=1e-3)
    with pytest.raises(ValueError, match="camera must be one, or 2, got 3"):
        ij.fit_cylinders(np.stack([depth, depth]), [CAMERA] * 3)


@FULL
@pytest.mark.usefixtures("double")
def test_derivatives_of_the_radius_are_those_of_finite_differences():
    depth, mask = image()
    depth = jnp.asarray(depth, float)
    start = ij.Cylinder(*(np.asarray(x, float) for x in (
        can().center, can().axis, can().radius, can().height)))  # fmt: skip

    # One compilation for all: reverse mode transposes what forward mode computes.
    @jax.jit
    @functools.partial(jax.value_and_grad, argnums=(0, 1))
    def radius(depth, fx):
        camera = ij.PinholeCamera(fx, 150.0, 79.5, 59.5, 160, 120)
        # Differences need values at the fixed point itself, where steps have ended.
        fit = ij.fit_cylinder(
            *(depth, camera, mask, SIGMA, start), effort=ij.Effort(tolerance=1e-4)
        )
        return fit.cylinder.radius

    focal = jnp.asarray(150.0)
    _, (by_depth, by_focal) = radius(depth, focal)
    direction = jnp.asarray(np.random.default_rng(0).normal(size=depth.shape))
    direction = jnp.where(jnp.asarray(mask), direction, 0)
    step = 1e-7
    numeric = (
        radius(depth + step * direction, focal)[0]
        - radius(depth - step * direction, focal)[0]
    ) / (2 * step)
    assert float(jnp.sum(by_depth * direction)) == pytest.approx(
        float(numeric), rel=1e-3
    )
    numeric = (radius(depth, focal + 1e-4)[0] - radius(depth, focal - 1e-4)[0]) / 2e-4
    assert float(by_focal) == pytest.approx(float(numeric), rel=1e-3)


@RELEASE
@pytest.mark.parametrize(("seed", "is_alone"), [(100292, True), (100922, False)])
def test_rod_whose_near_end_shows_in_a_corner_is_recovered(seed, is_alone):
    """4 % of the readings are the end's, and a fit first leaves them out."""
    view = scenes.draw_scene(seed, is_alone)
    fit = ij.fit_cylinder(view.depth, scenes.CAMERA, view.mask, scenes.SENSOR)
    assert fit.status is ij.FitStatus.CONVERGED
    assert np.any(fit.ends_seen)
    assert angle_between(fit.cylinder.axis, view.shape.axis) < 0.03
    off = float(fit.cylinder.radius - view.shape.radius)
    assert abs(off) < 3 * float(fit.std.radius)


@pytest.mark.parametrize(
    ("noise", "status"), [(0.0036, "converged"), (0.005, "poor_fit")]
)
def test_residuals_of_a_tenth_of_the_radius_are_no_bands_of_a_sensor(noise, status):
    # Five in two of what is told, and six, of a radius of 40 mm.
    depth, mask = image()
    more = np.random.default_rng(1).normal(0, noise, depth.shape)
    fit = ij.fit_cylinder(depth + more.astype(np.float32), CAMERA, mask, 0.0018)
    assert (float(fit.rms) > 0.004) is (status == "poor_fit")
    assert float(fit.chi2) > 4
    assert fit.status == status


@pytest.mark.parametrize("seed", [2, 5])
def test_a_start_that_leans_too_far_leads_to_the_truth(seed):
    # 2 mm and 2 degrees beside it, from the side: axes were 20 deviations off.
    truth = ij.Cylinder(
        (0.0046, -0.0029, 0.6326), (-0.9578, -0.2861, -0.0284), 0.0595, 0.0819
    )
    start = ij.Cylinder(
        (0.0068, -0.0022, 0.6322), (-0.9519, -0.2997, -0.0640), 0.0595, 0.0819
    )
    camera = ij.PinholeCamera(140.0, 140.0, 62.0, 48.0, 127, 95)
    scene = ij.Scene([truth, ij.Plane((0, 0, 1.3), (0, 0.1, -1))])
    maps = ij.render(scene, camera, outputs=("depth", "index"))
    noise = np.random.default_rng(seed).normal(0, 0.0015, (95, 127))
    depth, mask = np.asarray(maps.depth) + noise, np.asarray(maps.index) == 0
    held = ("radius", "height")
    fit = ij.fit_cylinder(depth, camera, mask, 0.0015, fixed=held, initial=start)
    assert fit.success
    off = np.radians(angle_between(fit.cylinder.axis, truth.axis))
    assert off < 4 * np.linalg.norm(fit.std.axis)
