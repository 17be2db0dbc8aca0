"""Every primitive is drawn, and as what it is."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.glsl.compare import compare
from impostor_jax.glsl.impostors import IMPOSTORS
from impostor_jax.glsl.program import attributes
from impostor_jax.glsl.reference import draw_with_jax
from impostor_jax.glsl.scene import scene_of
from impostor_jax.primitives import PRIMITIVES

CAMERA = ij.PinholeCamera(150.0, 140.0, 70.0, 66.0, width=160, height=120)
MOST_ATTRIBUTES = 16
"""Attributes of a vertex that every implementation of WebGL2 has."""


def test_every_primitive_has_a_shader():
    assert set(PRIMITIVES.values()) == set(IMPOSTORS)


@pytest.mark.parametrize("name", sorted(PRIMITIVES))
def test_instance_fits_into_the_attributes_of_a_vertex(name):
    assert len(attributes(IMPOSTORS[PRIMITIVES[name]])) <= MOST_ATTRIBUTES


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
    drawn, reference = renderer.draw(part, CAMERA), draw_with_jax(part, CAMERA)
    assert compare(reference, drawn).flips_off_band == 0
    assert (drawn.depth != renderer.draw(whole, CAMERA).depth).any()


def test_cylinder_that_is_not_whole_is_drawn_with_the_frusta():
    half = ij.Cylinder((0.0, 0.0, 2.0), (0, 1, 0), 0.3, 1.0, 0.0, 3.0)
    cup = ij.Frustum((0, 0, 2), (0, 1, 2), 0.2, 0.1)
    whole = ij.Cylinder((0.0, 0.0, 2.0), (0, 1, 0), 0.3, 1.0)
    draws = scene_of([half, whole, cup], CAMERA).draws
    assert [draw.impostor.name for draw in draws] == ["frustum", "cylinder"]
    assert [draw.rows[:, -1].tolist() for draw in draws] == [[0, 2], [1]]


def test_plane_is_drawn_to_its_horizon(renderer):
    """Beyond what the depth buffer tells apart, and in front of nothing."""
    floor = ij.Plane((0.0, 1e-3, 0.0), (0.0, 1.0, 1e-6))
    drawn, reference = renderer.draw(floor, CAMERA), draw_with_jax(floor, CAMERA)
    np.testing.assert_array_equal(drawn.mask, reference.mask)
    np.testing.assert_allclose(
        drawn.depth[drawn.mask], reference.depth[drawn.mask], rtol=1e-6
    )


def test_point_that_a_plane_is_given_by_does_not_matter_to_the_depth_buffer():
    stretches = [
        scene_of(ij.Plane((x, 1.0, 0.0), (0.0, 1.0, 0.0)), CAMERA).stretch
        for x in (0.0, 1e6)
    ]
    assert stretches[0] == stretches[1]


def test_wall_far_behind_a_ball_is_hidden_by_it(renderer):
    scene = [ij.Plane((0.0, 0.0, 1e7), (0, 0, 1)), ij.Sphere((0.0, 0.0, 2.0), 0.5)]
    for order in (scene, scene[::-1]):
        drawn = renderer.draw(order, CAMERA)
        assert drawn.mask.all()
        ball = drawn.index == (0 if order[0] is scene[1] else 1)
        seen = np.asarray(ij.render(scene[1], CAMERA, outputs=("mask",)).mask)
        np.testing.assert_array_equal(ball, seen)
