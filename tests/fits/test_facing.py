"""Points of a wall that face away from their origin contradict it."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fits.facing import share_away
from tests.fit.scenes import SIGMA, image
from tests.fits.test_points import points_of
from tests.groups import FULL, OF_POINTS

pytestmark = OF_POINTS
RADIUS = 0.25
NOISE = 0.003


def arc(half_angle, count=600, radius=RADIUS):
    """Noisy points of an upright wall about the origin, on both sides of +x."""
    rng = np.random.default_rng(0)
    angle = np.radians(rng.uniform(-half_angle, half_angle, count))
    distance = radius + rng.normal(0, NOISE, count)
    height = rng.uniform(-1, 1, count)
    return np.stack(
        [distance * np.cos(angle), distance * np.sin(angle), height], axis=1
    )


def away(points, *origin):
    return share_away(points, np.broadcast_to(np.array(origin), points.shape))


def test_of_what_an_origin_sees_nothing_faces_away():
    assert away(arc(80), 8.0, 0.0, 0.3) < 0.01


def test_from_the_wrong_side_most_of_the_wall_faces_away():
    assert away(arc(80), -8.0, 0.0, 0.3) > 0.9


@pytest.mark.parametrize("side", [1, -1])
def test_an_origin_60_degrees_off_sees_less_than_the_half(side):
    turn = np.radians(side * 60)
    share = away(arc(80), 8 * np.cos(turn), 8 * np.sin(turn), 0.3)
    # It sees to 60 - 90 + 2 = -28 degrees; what is a tenth beyond counts, to -36.
    assert share == pytest.approx((80 - 36) / 160, abs=0.06)


def test_from_inside_a_pipe_all_of_it_is_seen():
    assert away(arc(180), 0.05, 0.0, 0.0) == 0


def test_a_small_arc_does_not_tell():
    assert away(arc(4), -8.0, 0.0, 0.3) is None


def test_scattered_points_have_no_wall():
    cloud = np.random.default_rng(0).uniform(-1, 1, (600, 3))
    assert away(cloud, 8.0, 0.0, 0.3) in (None, 0)


@FULL
def test_a_wrong_origin_is_no_success():
    points = points_of(*image())
    middle = points.mean(axis=0)
    right = ij.fit_cylinder_to_points(points, (0, 0, 0), SIGMA)
    assert right.success
    behind = ij.fit_cylinder_to_points(points, 2 * middle, SIGMA)
    assert behind.status is ij.FitStatus.CONTRADICTED
    assert not behind.success
    assert np.isinf(behind.std.radius)
    assert " % of the wall's points face away from the origin" in behind.reason
    turn = np.radians(60)
    rotation = np.array([
        [np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)],
    ])  # fmt: skip
    aside = ij.fit_cylinder_to_points(points, middle - rotation @ middle, SIGMA)
    assert aside.status is ij.FitStatus.CONTRADICTED
