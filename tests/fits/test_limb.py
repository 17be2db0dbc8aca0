"""Readings that are mixed with what is behind a wall, beside its limb."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fits.limb import LIMB, rays_clear_of_limb
from tests.groups import FULL, OF_POINTS

pytestmark = OF_POINTS
RADIUS, NOISE, DISTANCE = 0.15, 0.003, 6.0
STEM = ij.Cylinder((DISTANCE, 0.0, 0.0), (0.0, 0.0, 1.0), RADIUS, 1.0)
ORIGIN = np.zeros(3)


def scanned(num_mixed, seed=0, behind=1.0, count=2000):
    """Points of an upright wall, and mixed ones beside its limb, seen from the origin.

    Rays are spread evenly across the wall; `behind` is 1 for readings behind it.
    """
    rng = np.random.default_rng(seed)
    limb = rng.uniform(0.97, 0.9999, num_mixed) * rng.choice([-1, 1], num_mixed)
    passes = np.concatenate([rng.uniform(-0.999, 0.999, count), limb])
    angle = passes * np.arcsin(RADIUS / DISTANCE)
    unit = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    chord = np.sqrt(RADIUS**2 - (DISTANCE * np.sin(angle)) ** 2)
    depth = DISTANCE * np.cos(angle) - chord + rng.normal(0, NOISE, len(angle))
    depth[count:] += behind * rng.exponential(0.15, num_mixed)
    points = depth[:, None] * unit
    points[:, 2] = rng.uniform(-0.5, 0.5, len(points))
    return points


def clear(points):
    return rays_clear_of_limb(STEM, points, np.broadcast_to(ORIGIN, points.shape))


def test_a_wall_alone_has_none():
    assert clear(scanned(0)) is None


def test_what_lies_in_front_is_not_mixed():
    assert clear(scanned(60, behind=-1.0)) is None


def test_from_inside_no_limb_is_seen():
    points = scanned(60)
    start = np.broadcast_to([DISTANCE, 0, 0], points.shape)
    assert rays_clear_of_limb(STEM, points, start) is None


def test_rays_that_pass_the_limb_are_told_whatever_they_read():
    points = scanned(60)
    found = clear(points)
    off = points[:2000] - [DISTANCE, 0, 0]
    # Parallel, as good as: the place across is that at which a ray passes.
    passes = np.abs(off[:, 1]) / RADIUS
    assert not found[2000:].any()
    assert np.all(found[:2000][passes < LIMB - 0.02])
    assert not np.any(found[:2000][passes > LIMB + 0.02])


@pytest.mark.parametrize("origin", [ORIGIN, None], ids=["origin", "none"])
@pytest.mark.parametrize("sigma", [NOISE, pytest.param(None, marks=FULL)])
def test_mixed_readings_do_not_draw_a_radius_in(origin, sigma):
    # One in ten drew it in by 20 and 4 deviations, and the fit said success.
    fit = ij.fit_cylinder_to_points(scanned(200, seed=1), origin, sigma)
    assert fit.success
    assert abs(float(fit.cylinder.radius) - RADIUS) < 3 * float(fit.std.radius)
    assert "mixed with what is behind it" in fit.reason


def test_without_doubts_they_are_not_looked_for():
    fit = ij.fit_cylinder_to_points(scanned(200), ORIGIN, NOISE, effort="fast")
    assert "mixed" not in fit.reason
