"""The filter alone: on measurements whose errors are known exactly."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.track.measured import basis_of
from impostor_jax.track.state import (
    AXIS,
    CENTER,
    HEIGHT,
    RADIUS,
    VELOCITY,
    Motion,
    State,
)
from tests.groups import FULL
from tests.track.scenes import AXIS as UPRIGHT
from tests.track.scenes import measured

MOTION = Motion(speed=1.0, acceleration=1.0, turning=0.5)
OWN = np.array([2e-3, 2e-3, 1e-4, 1e-4, 3e-4, 1e-4, 4e-4])
NO_SHARED = np.zeros((7, 8))
DT = 1 / 30


def scale_of(center, axis, deviation, radius=0.04, height=0.12):
    """What an error of the scale does to the coordinates, seen from the origin."""
    shared = np.zeros((7, 8))
    across = np.vstack([basis_of(axis), axis]) @ center
    shared[:, 0] = deviation * np.concatenate([[0, 0], across, [radius, height]])
    return shared


def error_of(state, center, velocity, axis):
    """State less the truth, in its coordinates."""
    tilt = basis_of(axis) @ state.axis
    sizes = [state.radius - 0.04, state.height - 0.12]
    return np.concatenate(
        [state.center - center, state.velocity - velocity, tilt, sizes]
    )


def test_the_basis_is_that_of_a_fit():
    for axis in np.random.default_rng(0).normal(size=(20, 3)):
        axis /= np.linalg.norm(axis)
        of_fits = tangent_basis(jnp.asarray(axis))
        np.testing.assert_allclose(basis_of(axis), of_fits, atol=1e-6)


@FULL
@pytest.mark.parametrize("scale", [0.0, 0.02])
def test_errors_are_as_large_as_the_covariance_says(scale):
    rng = np.random.default_rng(1)
    squares, of_sizes = [], []
    for _ in range(150):
        center = np.array([0.1, 0.0, 0.7]) + 0.05 * rng.normal(size=3)
        velocity, axis = MOTION.speed * rng.normal(size=3), UPRIGHT
        errors = np.concatenate([rng.normal(size=1), np.zeros(7)])
        state = None
        for k in range(12):
            if k:
                # The motion that the filter expects: white acceleration and tilt.
                push = MOTION.acceleration * rng.normal(size=(2, 3)) * np.sqrt(DT)
                center = center + DT * (velocity + push[0] / 2 + push[1] / np.sqrt(12))
                velocity = velocity + push[0]
                tilt = MOTION.turning * np.sqrt(DT) * rng.normal(size=2)
                axis = axis + tilt @ basis_of(axis)
                axis = axis / np.linalg.norm(axis)
            shared = scale_of(center, axis, scale)
            seen = measured(rng, center, axis, OWN, shared, errors=errors)
            state = (
                State.of(seen, MOTION)
                if state is None
                else state.predicted(DT, MOTION).updated(seen)
            )
        off = error_of(state, center, velocity, axis)
        full = state.whole_covariance
        squares.append(off @ np.linalg.solve(full, off))
        of_sizes.append(off[RADIUS:] / np.sqrt(np.diagonal(full))[RADIUS:])
    # Chi-squared of 10 degrees of freedom, whose mean of 150 is known to 0.37.
    assert abs(np.mean(squares) - 10) < 4 * 0.37
    # A deviation of 150 numbers is known to 6 %.
    assert abs(np.std(of_sizes, axis=0) - 1).max() < 0.25


def test_sizes_add_up_but_for_what_images_share():
    rng, center = np.random.default_rng(0), np.array([0.1, 0.0, 0.7])
    for scale in (0.0, 0.001):
        shared = scale_of(center, UPRIGHT, scale)
        state = State.of(measured(rng, center, UPRIGHT, OWN, shared), MOTION)
        for _ in range(24):
            seen = measured(rng, center, UPRIGHT, OWN, shared)
            state = state.predicted(DT, MOTION).updated(seen)
        std = np.sqrt(np.diagonal(state.whole_covariance))
        expected = np.hypot(OWN[5:] / 5, scale * np.array([0.04, 0.12]))
        np.testing.assert_allclose(std[RADIUS:], expected, rtol=1e-3)


def test_of_errors_that_last_an_image_tells_less():
    # The variance of the best mean of n terms of an autoregression of first order.
    rng, center, left, count = np.random.default_rng(0), np.array([0, 0, 0.7]), 0.6, 10
    state = State.of(measured(rng, center, UPRIGHT, OWN, NO_SHARED), MOTION)
    for _ in range(count - 1):
        seen = measured(rng, center, UPRIGHT, OWN, NO_SHARED)
        state = state.predicted(DT, MOTION).updated(seen, (1 + left) / (1 - left))
    terms = left ** np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    best = OWN[5] ** 2 / np.linalg.inv(terms).sum()
    assert state.covariance[RADIUS, RADIUS] == pytest.approx(best, rel=1e-6)


def after(count, shared, errors=None, **changes):
    """The state after some images of a can that stands still, and the last image."""
    rng, center, state = np.random.default_rng(0), np.array([0.1, 0.0, 0.7]), None
    for _ in range(count):
        seen = measured(rng, center, UPRIGHT, OWN, shared, errors=errors)
        seen = dataclasses.replace(seen, **changes)
        state = (
            State.of(seen, MOTION)
            if state is None
            else state.predicted(DT, MOTION).updated(seen)
        )
    return state, seen


def deviations(state):
    return np.sqrt(np.diagonal(state.whole_covariance))


@pytest.mark.parametrize("count", [1, 8])
def test_a_prior_is_told_once_and_not_once_an_image(count):
    state, seen = after(count, NO_SHARED)
    value, prior = 0.0402, 5e-5
    known = state.expecting({"radius": (value, prior), "height": (0.12, 1e-4)}, seen)
    for place, std in ((RADIUS, prior), (HEIGHT, 1e-4)):
        precision = std**-2 + count * OWN[place - 3] ** -2
        assert deviations(known)[place] == pytest.approx(precision**-0.5, rel=1e-6)
    weight = prior**-2 / (prior**-2 + count * OWN[5] ** -2)
    mean = weight * value + (1 - weight) * state.radius
    assert known.radius == pytest.approx(mean, rel=1e-9)


def test_a_radius_that_is_known_tells_the_scale_and_with_it_the_place():
    center, scale = np.array([0.1, 0.0, 0.7]), 0.02
    shared = scale_of(center, UPRIGHT, scale)
    state, seen = after(12, shared, errors=np.eye(8)[0])
    known = state.expecting({"radius": (0.04, 4e-5)}, seen)
    before, std = deviations(state)[CENTER][2], deviations(known)
    assert before == pytest.approx(scale * 0.7, rel=1e-2)
    # As unsure as the prior, and the noise of the radius, are in parts of it.
    left = np.hypot(4e-5, OWN[5] / np.sqrt(12)) / 0.04
    assert std[CENTER][2] == pytest.approx(left * 0.7, rel=0.02)
    assert abs(state.center[2] - 0.7) > 0.9 * before
    assert (np.abs(known.center - center) < 4 * std[CENTER]).all()
    assert std[RADIUS] < 4e-5


def test_a_height_that_is_known_tells_the_place_from_one_end():
    end, half = 0.06, 0.12 / 2
    open_end = np.array([True, True, True, True, False, True, False])
    # A third of it is out of sight: 8 cm end at the upper end.
    center = np.array([0.1, 0.0, 0.7]) + (end - 0.04) * UPRIGHT
    given = {"center": center, "height": 0.08, "is_known": open_end, "end": 1}
    state, seen = after(5, NO_SHARED, **given)
    assert not state.has_height
    known = state.expecting({"height": (0.12, 1e-3)}, seen)
    assert known.has_height
    assert (known.height, deviations(known)[HEIGHT]) == (0.12, pytest.approx(1e-3))
    off = known.center - np.array([0.1, 0.0, 0.7])
    assert UPRIGHT @ off == pytest.approx(end - half, abs=3e-4)
    along = np.sqrt(UPRIGHT @ known.whole_covariance[CENTER, CENTER] @ UPRIGHT)
    assert along == pytest.approx(np.hypot(seen.end_std, 1e-3 / 2), rel=0.02)
    # Of what shows no end the place is as open as before.
    state, seen = after(5, NO_SHARED, **{**given, "end": 0})
    assert not state.expecting({"height": (0.12, 1e-3)}, seen).has_height


def test_a_height_that_nothing_tells_leaves_all_else_sure():
    rng, velocity = np.random.default_rng(0), np.array([0.1, 0.05, 0.0])
    state = None
    for k in range(30):
        center = np.array([0.1, 0.0, 0.7]) + k * DT * velocity
        seen = measured(rng, center, UPRIGHT, OWN, NO_SHARED)
        known = np.array([True, True, True, True, False, True, False])
        # The upper end is seen, and something hides the lower one.
        seen = dataclasses.replace(seen, is_known=known, end=1)
        state = (
            State.of(seen, MOTION)
            if state is None
            else state.predicted(DT, MOTION).updated(seen)
        )
        assert not state.has_height
        assert np.isfinite(state.covariance).all()
    assert state.covariance[RADIUS, RADIUS] == pytest.approx(OWN[5] ** 2 / 30, rel=1e-3)
    np.testing.assert_allclose(state.velocity, velocity, atol=0.1)
    # More of it is seen than before: a gate that took the extent for its height took
    # it for another cylinder.
    whole = measured(rng, center, UPRIGHT, OWN, NO_SHARED, height=0.15)
    assert state.distance(whole)[0] < 25
    state = state.updated(whole)
    assert state.has_height
    assert state.covariance[HEIGHT, HEIGHT] == pytest.approx(OWN[6] ** 2, rel=1e-2)
    assert state.height == pytest.approx(whole.height, abs=1e-6)


def test_one_end_tells_the_place_of_a_can_of_known_height():
    rng, center = np.random.default_rng(0), np.array([0.1, 0.0, 0.7])
    state = State.of(measured(rng, center, UPRIGHT, OWN, NO_SHARED), MOTION)
    for _ in range(10):
        seen = measured(rng, center, UPRIGHT, OWN, NO_SHARED)
        # A third of it is out of sight; the visible extent ends there.
        seen = dataclasses.replace(
            seen,
            center=center + 0.02 * UPRIGHT,
            height=0.08,
            is_known=np.array([True, True, True, True, False, True, False]),
            end=1,
            end_std=0.001,
        )
        state = state.predicted(DT, MOTION).updated(seen)
    along = UPRIGHT @ (state.center - center)
    variance = UPRIGHT @ state.covariance[CENTER, CENTER] @ UPRIGHT
    assert abs(along) < 4 * np.sqrt(variance)
    # That of an end, and half of the height's.
    assert np.sqrt(variance) < 0.0011


def test_an_axis_that_turns_by_its_horizon_is_followed():
    # A fit signs its axis by the largest component, which changes on the way.
    rng, center, state = np.random.default_rng(0), np.array([0.0, 0.0, 0.7]), None
    for k in range(40):
        angle = np.radians(20 + 4 * k)
        axis = np.array([np.sin(angle), np.cos(angle), 0.05])
        axis /= np.linalg.norm(axis)
        seen = measured(rng, center, axis, OWN, NO_SHARED)
        if state is None:
            state = State.of(seen, Motion(1.0, 1.0, 1.0))
        else:
            state = state.predicted(DT, Motion(1.0, 1.0, 1.0)).updated(seen)
        assert state.axis @ axis > np.cos(np.radians(2))
    np.testing.assert_allclose(
        state.covariance, state.covariance.T, atol=1e-12 * state.covariance.max()
    )
    assert np.linalg.eigvalsh(state.covariance)[0] > 0


def test_an_axis_that_turns_by_much_between_two_images_is_where_the_second_shows_it():
    # By its tangent 20 degrees were 0.8 too few: seven deviations of a can that falls.
    motion, center = Motion(1.0, 1.0, 100.0), np.array([0.0, 0.0, 0.7])
    for k, angle in enumerate(np.radians([10, 20, 40, 80])):
        rng = np.random.default_rng(k)
        state = State.of(measured(rng, center, UPRIGHT, OWN, NO_SHARED), motion)
        axis = np.cos(angle) * UPRIGHT + np.sin(angle) * basis_of(UPRIGHT)[k % 2]
        seen = measured(rng, center, axis, OWN, NO_SHARED)
        state = state.predicted(DT, motion).updated(seen)
        tilt = basis_of(axis) @ state.axis
        assert np.abs(tilt).max() < 4 * OWN[0]


def test_chi_squared_of_what_differs_is_large():
    rng, center = np.random.default_rng(0), np.array([0.1, 0.0, 0.7])
    state = State.of(measured(rng, center, UPRIGHT, OWN, NO_SHARED), MOTION)
    same = measured(rng, center, UPRIGHT, OWN, NO_SHARED)
    other = measured(rng, center, UPRIGHT, OWN, NO_SHARED, radius=0.042)
    assert state.distance(same)[0] < 25
    assert state.distance(other)[0] > 100
    assert state.distance(same)[1] == 7


def test_velocity_and_place_are_those_of_a_moving_camera_whose_scale_errs():
    # The place is off by the part of the distance that the scale is off by, also where
    # the camera was elsewhere when a state began.
    rng, center = np.random.default_rng(0), np.array([0.0, 0.0, 1.0])
    errors = np.eye(8)[0]
    state = None
    for k in range(60):
        camera = np.array([0.5 * k * DT, 0.0, 0.0])
        shared = scale_of(center - camera, UPRIGHT, 0.02)
        seen = measured(rng, center, UPRIGHT, OWN, shared, errors=errors)
        state = (
            State.of(seen, MOTION)
            if state is None
            else state.predicted(DT, MOTION).updated(seen)
        )
    off = error_of(state, center, np.zeros(3), UPRIGHT)
    # What one standard deviation of the scale has done, and no more than noise.
    std = np.sqrt(np.diagonal(state.covariance))
    assert (np.abs(off - state.shared[:, 0]) < 5 * std).all()
    assert state.shared[RADIUS, 0] == pytest.approx(0.02 * 0.04, rel=1e-6)
    assert state.shared[VELOCITY, 0][0] == pytest.approx(-0.02 * 0.5, rel=0.02)
    assert np.abs(state.shared[AXIS, 0]).max() < 1e-9
