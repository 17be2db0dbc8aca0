"""Every primitive is drawn, and as what it is."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.glsl import draw_list
from impostor_jax.glsl.draw_list import draw_list_of
from impostor_jax.glsl.impostors import IMPOSTORS
from impostor_jax.glsl.program import SAMPLES_PER_ROW, attributes
from impostor_jax.parity.compare import compare
from impostor_jax.parity.flat_cases import random_heights, seen_pose
from impostor_jax.parity.run import drawn_by_jax
from impostor_jax.primitives import PRIMITIVES
from tests.groups import FULL, RELEASE

CAMERA = ij.PinholeCamera(150.0, 140.0, 70.0, 66.0, width=160, height=120)
MOST_ATTRIBUTES = 16
"""Attributes of a vertex that every implementation of WebGL2 has."""


def test_every_primitive_has_a_shader():
    assert set(PRIMITIVES.values()) == set(IMPOSTORS)


@pytest.mark.parametrize("name", sorted(PRIMITIVES))
def test_instance_fits_into_the_attributes_of_a_vertex(name):
    assert len(attributes(IMPOSTORS[PRIMITIVES[name]])) <= MOST_ATTRIBUTES


@FULL
@pytest.mark.parametrize(
    "opening",
    [{"start_angle": 0.5, "end_angle": 4.0}, {"caps": False}],
    ids=["sector", "open"],
)
def test_cylinder_that_is_not_whole_is_not_drawn_whole(renderer, opening):
    place = (0.0, 0.0, 0.5), (0.3, 0.2, 1.0), 0.08, 0.2
    whole, part = ij.Cylinder(*place), ij.Cylinder(*place, **opening)
    drawn = renderer.draw([part, whole], CAMERA)
    assert {0, 1} <= set(np.unique(drawn.index)), "the whole one fills the gap"
    drawn, reference = renderer.draw(part, CAMERA), drawn_by_jax(part, CAMERA)
    assert compare(reference, drawn).flips_off_band == 0
    assert (drawn.depth != renderer.draw(whole, CAMERA).depth).any()


def test_cylinder_that_is_not_whole_is_drawn_with_the_frusta():
    half = ij.Cylinder((0.0, 0.0, 2.0), (0, 1, 0), 0.3, 1.0, 0.0, 3.0)
    cup = ij.Frustum((0, 0, 2), (0, 1, 2), 0.2, 0.1)
    whole = ij.Cylinder((0.0, 0.0, 2.0), (0, 1, 0), 0.3, 1.0)
    calls = draw_list_of([half, whole, cup], CAMERA).calls
    assert [call.impostor.name for call in calls] == ["frustum", "cylinder"]
    assert [call.rows[:, -1].tolist() for call in calls] == [[0, 2], [1]]


def test_plane_is_drawn_to_its_horizon(renderer):
    """Beyond what the depth buffer tells apart, and in front of nothing."""
    floor = ij.Plane((0.0, 1e-3, 0.0), (0.0, 1.0, 1e-6))
    drawn, reference = renderer.draw(floor, CAMERA), drawn_by_jax(floor, CAMERA)
    np.testing.assert_array_equal(drawn.mask, reference.mask)
    np.testing.assert_allclose(
        drawn.depth[drawn.mask], reference.depth[drawn.mask], rtol=1e-6
    )


def test_point_that_a_plane_is_given_by_does_not_matter_to_the_depth_buffer():
    stretches = [
        draw_list_of(ij.Plane((x, 1.0, 0.0), (0.0, 1.0, 0.0)), CAMERA).stretch
        for x in (0.0, 1e6)
    ]
    assert stretches[0] == stretches[1]


def test_wall_far_behind_a_ball_is_hidden_by_it(renderer):
    shapes = [ij.Plane((0.0, 0.0, 1e7), (0, 0, 1)), ij.Sphere((0.0, 0.0, 2.0), 0.5)]
    for order in (shapes, shapes[::-1]):
        drawn = renderer.draw(order, CAMERA)
        assert drawn.mask.all()
        ball = drawn.index == (0 if order[0] is shapes[1] else 1)
        seen = np.asarray(ij.render(shapes[1], CAMERA, outputs=("mask",)).mask)
        np.testing.assert_array_equal(ball, seen)


def ground(shape, center, interpolation="bilinear"):
    """Rough ground of 1.5 m by 1 m, looked down at."""
    pose = seen_pose(30.0, 20.0, np.array(center))
    extent = ((-0.75, 0.75), (-0.5, 0.5))
    heights = 0.05 * random_heights(shape)
    return ij.Heightfield(heights, extent, interpolation, world_from_field=pose)


@RELEASE
def test_heightfields_of_any_grids_share_a_texture(renderer):
    """One of two samples a side, and one of more than a row of the texture."""
    grounds = [
        ground((2, 2), (-0.5, -0.3, 2.5), "bicubic"),
        ground((40, 30), (0.3, 0.1, 2.2)),
        ground((5, 3), (-0.3, 0.5, 2.0), "bicubic"),
    ]
    (call,) = draw_list_of(grounds, CAMERA).calls
    assert call.rows[:, -2].tolist() == [0, 4, 4 + 40 * 30]
    assert call.samples.shape == (2, SAMPLES_PER_ROW)
    drawn, reference = renderer.draw(grounds, CAMERA), drawn_by_jax(grounds, CAMERA)
    assert set(np.unique(drawn.index)) == {-1, 0, 1, 2}
    found = compare(reference, drawn)
    assert found.flips_off_band == 0
    assert found.depth_relative.p999 < 1e-6


@FULL
def test_world_pose_of_a_heightfield_and_of_the_camera_are_put_together(renderer):
    here = ground((5, 3), (0.0, 0.1, 2.0))
    turn = seen_pose(35.0, 50.0, np.array((0.3, -0.2, 0.4)))
    posed = ij.PinholeCamera(
        150.0, 140.0, 70.0, 66.0, 160, 120, camera_from_world=turn.inverse()
    )
    drawn = renderer.draw(here.transformed(turn), posed)
    found = compare(renderer.draw(here, CAMERA), drawn)
    assert drawn.mask.any()
    assert found.flips_off_band == 0
    assert found.depth_relative.p999 < 1e-5


@FULL
@pytest.mark.parametrize("interpolation", ["bilinear", "bicubic"])
def test_camera_on_a_heightfield_sees_it_where_it_is_crossed_next(
    renderer, interpolation
):
    # On a saddle's middle, which is 0 in any rounding.
    saddle = 0.3 * np.outer((-1.0, 0.0, 1.0), (-1.0, 0.0, 1.0))
    here = ij.Heightfield(
        saddle,
        ((-1, 1), (-1, 1)),
        interpolation,
        world_from_field=seen_pose(20.0, 30.0, np.zeros(3)),
    )
    drawn, reference = renderer.draw(here, CAMERA), drawn_by_jax(here, CAMERA)
    assert drawn.mask.sum() > 200
    np.testing.assert_array_equal(drawn.mask, reference.mask)
    apart = np.abs(drawn.depth[drawn.mask] - reference.depth[drawn.mask])
    assert np.percentile(apart, 99) < 1e-5
    assert np.percentile(drawn.depth[drawn.mask], 10) > 0.1


def test_heightfield_that_no_shader_can_draw_is_named(monkeypatch):
    hill = ij.Heightfield(lambda x, z: x * z, ((-1, 1), (-1, 1)), lipschitz=2.0)
    with pytest.raises(ValueError, match="height must be an array where a shader"):
        draw_list_of(hill, CAMERA)
    several = ij.Heightfield(np.zeros((2, 3, 3)), ((-1, 1), (-1, 1)))
    with pytest.raises(ValueError, match="give several as a sequence"):
        draw_list_of(several, CAMERA)
    monkeypatch.setattr(draw_list, "MOST_SAMPLES", 14)
    with pytest.raises(ValueError, match="at most 14 samples in all, got 15"):
        draw_list_of(ground((5, 3), (0.0, 0.0, 2.0)), CAMERA)
