"""Walls that are proposed, grown, and told from what is none."""

import numpy as np
import pytest

from impostor_jax.clouds import search
from impostor_jax.clouds.cloud import cloud_of
from impostor_jax.clouds.confidence import FACTS, confidence, facts_of
from impostor_jax.clouds.planes import planes_of
from impostor_jax.clouds.search import (
    MOST_AGAINST,
    Request,
    _is_likely,
    continues,
    searched,
)
from impostor_jax.clouds.support import supported, with_rays
from tests.clouds.scenes import ball, floor, wall
from tests.groups import FULL, RELEASE

REQUEST = Request(radius_range=(0.01, 1.0))


def found_in(points, origins=None, request=REQUEST):
    cloud = cloud_of(points, origins)
    return cloud, searched(cloud, planes_of(cloud), request)


def test_pipes_that_cross_are_found_from_end_to_end():
    rng = np.random.default_rng(0)
    first = wall(rng, 6000, (0, 0, 0), (1, 0, 0), 0.05, 2.0, noise=0.001)
    second = wall(rng, 6000, (0.3, 0, 0.13), (0, 1, 0.05), 0.08, 1.5, noise=0.001)
    cloud, found = found_in(np.concatenate([first, second]))
    assert len(found) == 2
    for one, (radius, length, start) in zip(
        sorted(found, key=lambda one: one.support.wall.radius),
        [(0.05, 2.0, 0), (0.08, 1.5, 6000)],
        strict=True,
    ):
        wall_of = one.support.wall
        assert wall_of.radius == pytest.approx(radius, abs=2e-4)
        assert wall_of.scatter == pytest.approx(0.001, rel=0.2)
        assert one.support.length == pytest.approx(length, rel=0.02)
        assert one.support.arc == pytest.approx(2 * np.pi, rel=0.05)
        is_own = (one.own >= start) & (one.own < start + 6000)
        assert np.mean(is_own) > 0.98
        assert len(one.own) > 5700
        assert confidence(facts_of(cloud, one.support)) > 0.9


@FULL
def test_a_wall_that_is_refused_is_asked_for_a_few_times(monkeypatch):
    rng = np.random.default_rng(0)
    asked = []

    def counted(cloud, free, one, least):
        asked.append(one)
        return supported(cloud, free, one, least)

    monkeypatch.setattr(search, "supported", counted)
    pipe = wall(rng, 3000, (0, 0, 0), (1, 0, 0), 0.1, 2.0, noise=0.001)
    _, found = found_in(pipe, request=Request(min_points=10**6))
    # 5946 patches propose it, and 30 of them are asked: the first, and what is apart.
    assert not found
    assert 3 <= len(asked) < 100


@FULL
def test_a_thin_pipe_of_few_points_is_as_full_as_a_thick_one():
    # Most of its cells were empty by chance, and it was no wall.
    rng = np.random.default_rng(0)
    thin = wall(rng, 900, (0, 0, 0), (1, 0, 0), 0.05, 6.0, (-1.3, 1.3), 0.002)
    _, (one,) = found_in(thin)
    assert one.support.filled == pytest.approx(0.95, abs=0.05)
    assert one.support.length == pytest.approx(6.0, rel=0.02)


@RELEASE
def test_a_wall_around_several_pipes_leaves_their_points_to_them():
    rng = np.random.default_rng(0)
    turns = np.radians([-45, -15, 15, 45])
    axes = 0.35 * np.stack([np.sin(turns), np.cos(turns)], axis=1)
    # Outer sides of pipes that lie side by side along an arc.
    out = rng.uniform(-1.2, 1.2, (4, 1500)) + turns[:, None]
    points = np.stack(
        [
            rng.uniform(0, 3, out.shape),
            axes[:, :1] + rng.normal(0.085, 0.002, out.shape) * np.sin(out),
            axes[:, 1:] + rng.normal(0.085, 0.002, out.shape) * np.cos(out),
        ],
        axis=-1,
    )
    _, found = found_in(points.reshape(-1, 3))
    assert [one.support.wall.radius for one in found] == pytest.approx(
        4 * [0.085], 0.05
    )


@FULL
def test_a_wall_goes_on_behind_an_occluder():
    rng = np.random.default_rng(1)
    points = wall(rng, 8000, (0, 0, 0), (0, 0, 1), 0.1, 3.0, (-1.4, 1.4), 0.002)
    # A gap of two radii.
    gap = (points[:, 2] > 0.2) & (points[:, 2] < 0.4)
    _, found = found_in(points[~gap])
    (one,) = found
    assert one.support.length == pytest.approx(3.0, rel=0.02)


@FULL
def test_a_ball_and_a_box_are_less_likely_than_a_pipe():
    rng = np.random.default_rng(2)
    pipe = wall(rng, 4000, (0, 0, 0), (0, 0, 1), 0.1, 1.0, noise=0.001)
    cloud, found = found_in(pipe)
    sure = max(confidence(facts_of(cloud, one.support)) for one in found)
    orders = ([0, 1, 2], [0, 2, 1], [2, 0, 1])
    sides = [floor(rng, 1500, 0.3, 0.15, 0.001)[:, order] for order in orders]
    sides += [-side for side in sides]
    for points in (ball(rng, 4000, (0, 0, 0), 0.2, 0.001), np.concatenate(sides)):
        cloud, found = found_in(points)
        chances = [confidence(facts_of(cloud, one.support)) for one in found]
        assert max(chances, default=0.0) < 0.5 < 0.9 < sure


@FULL
def test_rays_through_a_wall_speak_against_it():
    rng = np.random.default_rng(3)
    origin = np.array([0.0, 3.0, 0.0])
    pipe = wall(rng, 3000, (0, 0, 0), (0, 0, 1), 0.2, 2.0, (-1.3, 1.3), 0.002)
    beyond = rng.uniform((-0.15, -1.5, -0.8), (0.15, -1.0, 0.8), (3000, 3))
    points = np.concatenate([pipe, beyond])
    _, found = found_in(points)
    (one,) = [one for one in found if len(one.own) > 2500]
    cloud = cloud_of(points, np.broadcast_to(origin, points.shape))
    free = np.ones(len(points), bool)
    support = with_rays(cloud, supported(cloud, free, one.support.wall, 0.001))
    # The search would propose what is refused from each of its patches.
    assert len(support.on) > 2500
    assert support.behind > MOST_AGAINST > 0.1 > one.support.behind
    assert _is_likely(support, REQUEST)


@RELEASE
def test_pieces_of_one_thing_are_told_from_two():
    rng = np.random.default_rng(4)

    def piece(center, axis, radius):
        cloud, found = found_in(wall(rng, 1500, center, axis, radius, 1.0, noise=0.001))
        return found[0].support.moved(cloud.middle)

    first = piece((0, 0, 0), (0, 0, 1), 0.1)
    assert continues(first, piece((0.01, 0, 1.0), (0.03, 0, 1), 0.09))
    assert not continues(first, piece((0.3, 0, 1.0), (0, 0, 1), 0.1))
    assert not continues(first, piece((0, 0, 1.0), (0, 1, 0), 0.1))
    assert not continues(first, piece((0, 0, 1.0), (0, 0, 1), 0.03))


def test_each_fact_has_a_weight():
    rng = np.random.default_rng(5)
    cloud, found = found_in(
        wall(rng, 3000, (0, 0, 0), (0, 0, 1), 0.1, 1.0, noise=0.001)
    )
    facts = facts_of(cloud, found[0].support)
    assert facts.shape == (len(FACTS),)
    assert np.isfinite(facts).all()
