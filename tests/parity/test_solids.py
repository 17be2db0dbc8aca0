"""Solids made of solids, drawn and traced as what they are made of is."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.glsl.draw_list import draw_list_of
from impostor_jax.glsl.program import attributes
from impostor_jax.glsl.trace_list import trace_list_of
from impostor_jax.glsl.trace_program import trace_sources
from impostor_jax.parity.compare import compare
from impostor_jax.parity.flat_cases import random_heights, seen_pose
from tests.groups import FULL, RELEASE

pytest.importorskip("moderngl")

CAMERA = ij.PinholeCamera(150.0, 140.0, 79.5, 59.5, width=160, height=120)
LIGHTS = [ij.AmbientLight(0.2), ij.PointLight((1.0, -2.0, 1.0), (0.9, 0.8, 0.7))]
SKY = (0.2, 0.3, 0.5)
GLASS = ij.Material((0.9, 1.0, 0.9), 60.0, 0.1, 0.7, 1.4)

POSE = seen_pose(40.0, 20.0, np.array((0.1, 0.1, 2.0)))
UP, ACROSS = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)
SHAPES = {
    "ball": ij.Sphere((0.0, 0.1, 0.0), 0.4),
    "box": ij.Box((0.0, 0.0, 0.1), np.eye(3), (0.8, 0.5, 0.6)),
    "can": ij.Cylinder((0.0, 0.0, 0.0), (0.3, 1.0, 0.2), 0.3, 0.7),
    "piece": ij.Cylinder((0.0, 0.0, 0.0), UP, 0.4, 0.5, 0.4, 2.0, ACROSS),
    "wheel": ij.Cylinder((0.0, 0.0, 0.0), UP, 0.4, 0.5, 2.0, 6.4, ACROSS),
    "cup": ij.Frustum((0.0, -0.3, 0.0), (0.0, 0.3, 0.1), 0.2, 0.4),
    "cone": ij.Frustum((0.0, -0.3, 0.0), (0.0, 0.3, 0.1), 0.4, 0.0),
    "ring": ij.Torus((0.0, 0.0, 0.0), (0.2, 1.0, 0.3), 0.4, 0.15),
    "half-space": ij.Plane((0.0, 0.0, 0.0), (0.2, 1.0, 0.3)),
}


# CI has no time for all; the matrix draws them in other solids.
SHORT = ("box", "wheel", "ring")


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name in SHORT else RELEASE) for name in SHAPES],
)
def test_solid_of_one_shape_is_seen_as_the_shape(renderer, name):
    shape = SHAPES[name]
    solid = ij.union(shape, shape).transformed(POSE)
    drawn = renderer.draw(solid, CAMERA)
    found = compare(renderer.draw(shape.transformed(POSE), CAMERA), drawn)
    assert found.num_hits > 1000
    assert found.flips_off_band == 0
    # The solid is met by a ray that is turned, and rounded once more.
    assert found.depth_ulp.p99 <= 16
    assert found.normal_deg.p999 < 0.01
    # The second one's are never nearer, but for rounding.
    first = shape.num_parts
    assert np.all(drawn.part[drawn.mask] % first >= 0)


@FULL
@pytest.mark.parametrize(
    "interpolation", ["bilinear", pytest.param("bicubic", marks=RELEASE)]
)
def test_ground_without_a_hole_is_seen_as_the_ground(renderer, interpolation):
    field = ij.Heightfield(
        0.05 * random_heights((9, 7)),
        ((-0.7, 0.7), (-0.5, 0.5)),
        interpolation,
        world_from_field=POSE,
    )
    hidden = ij.Sphere((0.1, 0.6, 2.6), 0.1)
    reference = renderer.draw(field, CAMERA)
    drawn = renderer.draw(field - hidden, CAMERA)
    # Beside the surface the cuts below the ends of the extent are seen.
    top = reference.mask & (drawn.part == 0)
    assert np.count_nonzero(top) > 0.95 * np.count_nonzero(reference.mask)
    np.testing.assert_allclose(drawn.depth[top], reference.depth[top], rtol=2e-6)


@FULL
def test_solids_of_one_structure_are_one_call():
    place = np.array([[0.0, 0.0, 2.0], [0.5, 0.0, 2.0]])
    cans = ij.Cylinder(place, np.full((2, 3), UP), np.full(2, 0.2), np.full(2, 0.5))
    bores = ij.Cylinder(place, np.full((2, 3), UP), np.full(2, 0.1), np.full(2, 0.5))
    ball = ij.Sphere((0.0, 0.0, 3.0), 0.5)
    calls = draw_list_of([cans - bores, ball, ball - ball, ball - ball], CAMERA).calls
    assert [len(call.rows) for call in calls] == [2, 1, 2]
    assert [call.rows[:, -1].tolist() for call in calls] == [[0, 1], [2], [3, 4]]
    assert [call.numbers.size > 0 for call in calls] == [True, False, True]


@FULL
def test_instance_of_a_solid_fits_into_the_attributes_of_a_vertex():
    field = ij.Heightfield(np.zeros((3, 4)), ((-1, 1), (-1, 1)))
    (call,) = draw_list_of(field & SHAPES["ball"], CAMERA).calls
    assert len(attributes(call.impostor)) <= 16


def test_heightfield_of_a_function_in_a_solid_is_named():
    hill = ij.Heightfield(lambda x, z: x * z, ((-1, 1), (-1, 1)), lipschitz=2.0)
    with pytest.raises(ValueError, match="height must be an array where a shader"):
        draw_list_of(hill - SHAPES["ball"], CAMERA)


@FULL
def test_solids_of_one_shape_are_traced_as_the_shapes(renderer):
    names = ("ball", "can", "wheel", "box")
    places = np.array(
        [[-0.6, -0.3, 2.2], [0.5, 0.3, 2.0], [0.5, -0.4, 2.4], [-0.4, 0.4, 2]]
    )
    shapes = [
        SHAPES[name].transformed(seen_pose(40.0, 20.0, place))
        for name, place in zip(names, places, strict=True)
    ]
    # Two of one structure, and one of another that shares a shape with them.
    solids = [shapes[0] | shapes[0], shapes[1], *map(ij.union, shapes[2:])]
    made = [GLASS] * 4
    seen, same = (
        renderer.trace(scene, CAMERA, LIGHTS, made, SKY) for scene in (shapes, solids)
    )
    apart = np.abs(seen - same).max(axis=-1)
    assert np.percentile(apart, 95) < 1e-5
    assert np.count_nonzero(apart > 1e-3) < 0.03 * apart.size  # on the edges


def test_scene_without_a_solid_compiles_nothing_for_solids():
    scenes = [SHAPES["can"]], [SHAPES["can"], SHAPES["can"] - SHAPES["ball"]]
    texts = [
        trace_sources(trace_list_of(scene, CAMERA, LIGHTS).key, "330")[1]
        for scene in scenes
    ]
    assert ["struct Stretch" in text for text in texts] == [False, True]
    assert texts[1].count("struct Stretch {") == 1
