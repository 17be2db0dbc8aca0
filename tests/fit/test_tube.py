"""Tubes: outside and inside, what is not seen, and what is in the way."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.primitives.tube import as_tube
from tests.fit.scenes import CAMERA, SIGMA, can, image, image_of
from tests.groups import FULL, RELEASE, SMALL_IMAGES

pytestmark = SMALL_IMAGES

OUTER, INNER, HEIGHT = 0.04, 0.034, 0.12


def pipe(degrees: float = 40.0, inner: float = INNER) -> ij.Solid:
    """The can, with a bore."""
    outer = can(degrees)
    return ij.tube(outer.center, outer.axis, OUTER, inner, HEIGHT)


def mug(degrees: float = 20.0, thickness: float = 0.006) -> ij.Solid:
    """The pipe, but closed at the far end."""
    outer = can(degrees)
    bore = ij.Cylinder(outer.center - outer.axis * thickness, outer.axis, INNER, HEIGHT)
    return outer - bore


def fit_of(shape, seed=0, **asked):
    depth, mask = image_of(shape, seed=seed)
    return ij.fit_tube(depth, CAMERA, mask=mask, sigma=SIGMA, **asked)


def scores_of(fit, names=("outer_radius", "inner_radius")):
    """Errors in standard deviations."""
    truth = {"outer_radius": OUTER, "inner_radius": INNER, "height": HEIGHT}
    return [
        float((getattr(fit.tube, name) - truth[name]) / getattr(fit.std, name))
        for name in names
    ]


def test_a_tube_is_what_it_is_made_of_wherever_it_is_moved():
    given = (0.1, 0.2, 1.0), (0.0, 0.6, 0.8), 0.04, 0.03, 0.12
    about_z = jnp.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turn = ij.RigidTransform(about_z, jnp.ones(3))
    own = as_tube(ij.tube(*given))
    moved = as_tube(ij.tube(*given).transformed(turn))
    for part, expected in zip(own, given, strict=True):
        np.testing.assert_allclose(part, expected, rtol=1e-6)
    np.testing.assert_allclose(moved.center, [0.8, 1.1, 2.0], rtol=1e-6)
    np.testing.assert_allclose(moved.axis, [-0.6, 0.0, 0.8], rtol=1e-6, atol=1e-7)
    assert (moved.inner_radius, moved.height) == (own.inner_radius, own.height)


@pytest.mark.parametrize(
    ("inner", "outer", "said"),
    [(0.04, 0.04, "less than outer_radius"), (0.0, 0.04, "radius must be positive")],
)
def test_a_bore_is_narrower_than_its_tube(inner, outer, said):
    with pytest.raises(ValueError, match=said):
        ij.tube((0, 0, 1), (0, 0, 1), outer, inner, 0.1)


@FULL
def test_noisy_pipe_is_recovered_within_its_deviations():
    scores = []
    for seed in range(12):
        fit = fit_of(pipe(), seed)
        assert fit.status is ij.FitStatus.CONVERGED
        assert np.asarray(fit.ends_seen).all()
        scores += scores_of(fit, ("outer_radius", "inner_radius", "height"))
    assert float(fit.std.outer_radius) < 5e-5
    assert float(fit.std.inner_radius) < 5e-5
    assert fit.rms == pytest.approx(SIGMA, rel=0.05)
    # 36 draws, partly correlated: their own deviation is known to about 15 percent.
    assert np.abs(scores).max() < 4
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.5
    depth = ij.render(fit.shape, CAMERA, outputs=("depth",)).depth
    true = ij.render(pipe(), CAMERA, outputs=("depth",)).depth
    assert np.median(np.abs(depth - true)[fit.inliers]) < 1e-4


@pytest.mark.parametrize(
    ("degrees", "inner"), [(5.0, 0.034), (20.0, 0.02), (60.0, 0.038), (75.0, 0.01)]
)
def test_any_bore_and_view_is_recovered(degrees, inner):
    fit = fit_of(pipe(degrees, inner))
    assert fit.status is ij.FitStatus.CONVERGED
    off = float(fit.tube.inner_radius) - inner
    assert abs(off) < 4 * float(fit.std.inner_radius) < 2e-3
    assert abs(scores_of(fit)[0]) < 4


def test_an_inner_wall_that_is_not_seen_is_open_and_no_failure():
    side = fit_of(pipe(90.0))
    lid = fit_of(can(40.0))
    for fit in (side, lid):
        assert fit.status is ij.FitStatus.CONVERGED
        assert np.isinf(fit.std.inner_radius)
        assert abs(scores_of(fit)[0]) < 4
        assert "inner_radius" in str(fit)
    # What readings of a lid leave room for is a pixel.
    assert float(lid.tube.inner_radius) < 0.002
    # Also from a start that has a bore where the lid is.
    begun = fit_of(can(40.0), initial=pipe(40.0))
    assert begun.success
    assert np.isinf(begun.std.inner_radius)
    assert float(begun.tube.inner_radius) < 0.002


@RELEASE
def test_a_pipe_that_is_seen_from_inside_has_no_outside():
    around = ij.tube((0.0, 0.01, 0.1), (0.05, 0.0, 1.0), 0.25, 0.2, 1.4)
    depth, mask = image_of(around, wall=None)
    fit = ij.fit_tube(depth, CAMERA, mask=mask, sigma=SIGMA)
    assert fit.success
    assert np.isinf(fit.std.outer_radius)
    off = float(fit.tube.inner_radius) - 0.2
    assert abs(off) < 4 * float(fit.std.inner_radius)


def test_a_floor_is_no_wall():
    for seed in range(3):
        fit = fit_of(mug(), seed)
        assert fit.success
        assert np.abs(scores_of(fit)).max() < 4
        # The floor's pixels, and the wall's beside it, are none of the fit's.
        _, mask = image_of(mug(), seed=seed)
        assert np.count_nonzero(mask & ~np.asarray(fit.region)) > 50


@RELEASE
def test_a_bore_that_something_fills_is_no_success():
    depth, mask = map(np.array, image_of(pipe()))
    seen = ij.render(can(40.0), CAMERA, outputs=("depth",)).depth
    deep = mask & (depth - np.asarray(seen) > 0.01)
    # Some of it 10 mm below the mouth, some 50: no floor.
    rows = np.random.default_rng(0).random(depth.shape)
    depth[deep & (rows < 0.7)] -= (0.05 * rows[deep & (rows < 0.7)]).astype(np.float32)
    fit = ij.fit_tube(depth, CAMERA, mask=mask, sigma=SIGMA)
    assert not fit.success


@FULL
def test_outliers_and_wrong_masks_do_not_move_the_walls():
    depth, mask = map(np.array, image_of(pipe()))
    rng = np.random.default_rng(0)
    wrong = rng.random(depth.shape) < 0.1
    moved = np.where(wrong, rng.uniform(0.2, 1.0, depth.shape), depth)
    moved = moved.astype(np.float32)
    larger = np.zeros_like(mask)
    for down, right in ((2, 0), (-2, 0), (0, 2), (0, -2), (0, 0)):
        larger |= np.roll(mask, (down, right), (0, 1))
    for seen, part in ((moved, mask), (depth, larger)):
        fit = ij.fit_tube(seen, CAMERA, mask=part, sigma=SIGMA)
        assert fit.success
        assert np.abs(scores_of(fit)).max() < 4.5


@RELEASE
def test_what_is_no_tube_is_no_success():
    ball = ij.Sphere((0.01, 0.0, 0.35), 0.05)
    assert not fit_of(ball).success
    cup = ij.Frustum((0.0, 0.0, 0.3), (0.05, 0.05, 0.4), 0.03, 0.05)
    assert not fit_of(cup).success


def test_held_and_expected_radii_count():
    asked = {"fixed": ("inner_radius",), "prior": {"outer_radius": (0.04005, 1e-6)}}
    fit = fit_of(pipe(), initial=pipe(), **asked)
    assert float(fit.tube.inner_radius) == pytest.approx(INNER, rel=1e-6)
    assert float(fit.std.inner_radius) == 0
    assert float(fit.tube.outer_radius) == pytest.approx(0.04005, abs=5e-6)
    # Of what is not seen a prior is all there is.
    side = fit_of(pipe(90.0), prior={"inner_radius": (0.03, 0.001)})
    assert float(side.std.inner_radius) == pytest.approx(0.001, rel=0.05)
    assert float(side.tube.inner_radius) == pytest.approx(0.03, abs=1e-4)


def test_a_start_must_be_a_tube():
    longer = ij.Cylinder((0, 0, 0.4), (0, 0, 1), 0.03, 0.2)
    outer = ij.Cylinder((0, 0, 0.4), (0, 0, 1), 0.04, 0.1)
    for start in (outer - longer, outer | longer):
        with pytest.raises(ValueError, match="initial must be one tube"):
            fit_of(pipe(), initial=start)
    with pytest.raises(ValueError, match="fixed must be one of"):
        fit_of(pipe(), initial=pipe(), fixed=("radius",))
    with pytest.raises(AttributeError, match="got that of a tube"):
        _ = fit_of(pipe()).cylinder


@RELEASE
def test_a_traced_fit_is_the_same_and_fails_on_a_floor():
    @jax.jit
    def fitted(depth, mask, start):
        return ij.fit_tube(depth, CAMERA, mask=mask, sigma=SIGMA, initial=start)

    depth, mask = image_of(pipe())
    fit, plain = fitted(depth, mask, pipe()), fit_of(pipe(), initial=pipe())
    assert bool(fit.success)
    radii = [float(one.tube.inner_radius) for one in (fit, plain)]
    # Their steps end within a fifth of a deviation of where they lead.
    off = float(plain.std.inner_radius)
    assert radii[0] == pytest.approx(radii[1], abs=off)
    depth, mask = image_of(mug(10.0))
    assert not bool(fitted(depth, mask, pipe(10.0)).success)


@FULL
def test_a_can_needs_no_bore_and_a_pipe_does():
    for shape, is_needed in ((can(40.0), False), (can(90.0), False), (pipe(), True)):
        depth, mask = image_of(shape)
        test = ij.test_bore(ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA))
        assert bool(test.is_needed()) == is_needed
        assert (float(test.statistic) > 1000) == is_needed
        assert (float(test.p_value) == 1) != is_needed
        assert ("not needed" in str(test)) != is_needed
    # From a start of its own, and with what was known of it.
    depth, mask = image_of(pipe())
    asked = {"initial": can(40.0), "prior": {"radius": (OUTER, 1e-3)}}
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA, **asked)
    assert bool(ij.test_bore(fit).is_needed())


def test_a_bore_is_tested_only_of_what_a_fit_returned():
    depth, mask = image()
    fit = ij.fit_cylinder(depth, CAMERA, mask=mask, sigma=SIGMA)
    stacked = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), fit)
    with pytest.raises(ValueError, match="fit must be as fit_cylinder returned it"):
        ij.test_bore(stacked)
    with pytest.raises(ValueError, match=r"fit must be of a cylinder .* got a tube"):
        ij.test_bore(fit_of(pipe()))


@FULL
@pytest.mark.parametrize("seed", [4, 7])
def test_a_part_of_a_cone_is_no_tube(seed):
    # Half of its readings and fewer were taken, which look like one to the noise: 9 of
    # 16 such were a success, now 3, with radii of 40 to 46 mm and deviations of .6.
    rng = np.random.default_rng(seed)
    center = rng.uniform((-0.05, -0.04, 0.3), (0.05, 0.04, 0.4))
    axis = rng.normal(size=3)
    axis *= 0.05 / np.linalg.norm(axis)
    fit = fit_of(ij.Frustum(center - axis, center + axis, 0.05, 0.015), seed)
    assert not fit.success
