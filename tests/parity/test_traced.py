"""What the shader that traces a scene promises beside JAX's pictures."""

import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.glsl.offscreen import OffscreenRenderer
from impostor_jax.parity.traced_cases import traced
from tests.groups import FULL

pytest.importorskip("moderngl")

CAMERA = ij.PinholeCamera(54.0, 54.0, 31.5, 23.5, width=64, height=48)
LIGHTS = [ij.AmbientLight(0.2), ij.PointLight((1.0, -2.0, 1.0), (0.9, 0.8, 0.7))]
SKY = (0.2, 0.3, 0.5)
BALL = ij.Sphere((0.0, 0.1, 2.0), 0.4)
CORNERS = np.array([[-1, 0.5, -4], [-1, 0.5, 4], [1, 0.5, 4], [1, 0.5, -4]], float)
GLASS = ij.Material((0.9, 1.0, 0.9), 60.0, 0.1, 0.7, 1.4)


@FULL
def test_picture_is_that_of_jax_in_the_world_of_the_camera(renderer):
    pose = np.array(
        [[0.0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1]], np.float32
    )
    camera = ij.PinholeCamera(54.0, 54.0, 31.5, 23.5, 64, 48, None, False, pose)
    # A scene keeps its shapes by type; the materials go by the order that was given.
    scene = ij.Scene([BALL, ij.Box((0.5, 0, 2.5), np.eye(3), (0.4, 0.5, 0.3)), BALL])
    made = [ij.Material((1, 0, 0)), ij.Material((0, 1, 0), 20.0), ij.Material()]
    drawn = renderer.trace(scene, camera, LIGHTS, made, SKY)
    reference = np.asarray(ij.trace(scene, camera, LIGHTS, made, SKY))
    apart = np.abs(drawn - reference).max(axis=-1)
    assert np.percentile(apart, 95) < 1e-6
    assert np.count_nonzero(apart > 1e-4) <= 4  # on the edges


@FULL
@pytest.mark.parametrize("material", [ij.Material(reflect=0.5), GLASS])
def test_flat_heightfield_is_seen_as_two_triangles_are(renderer, material):
    ground = ij.Heightfield(np.full((4, 5), 0.5), ((-1.0, 1.0), (-4.0, 4.0)))
    # The camera sees both from inside: the normals look along y, which is down.
    sheet = ij.Triangle(np.stack([CORNERS[[0, 1, 2]], CORNERS[[0, 2, 3]]]))
    ball = ij.Material((1.0, 0.3, 0.2), 30.0, 0.3)
    seen, same = (
        renderer.trace([BALL, floor], CAMERA, LIGHTS, [ball, *made], SKY)
        for floor, made in ((ground, [material]), (sheet, [material] * 2))
    )
    apart = np.abs(seen - same).max(axis=-1)
    assert np.percentile(apart, 98) < 1e-5
    assert np.ptp(seen[-8:]) > 0.05


@FULL
def test_all_shapes_together_are_one_shader(renderer):
    case = traced("perspective")[-1]
    ground = ij.Heightfield(np.full((4, 5), 0.5), ((-2.0, 2.0), (2.5, 4.0)))
    pictures = [
        renderer.trace(
            shapes, CAMERA, case.lights, [*case.materials, GLASS][: len(shapes)], SKY
        )
        for shapes in (case.shapes, [*case.shapes, ground])
    ]
    assert all(np.isfinite(picture).all() for picture in pictures)
    assert (pictures[0] != pictures[1]).any()


def test_scenes_of_the_same_kinds_share_a_program(renderer):
    with OffscreenRenderer() as fresh:
        for shapes in ([BALL], [BALL, BALL], ij.Scene([BALL])):
            fresh.trace(shapes, CAMERA, LIGHTS)
        assert len(fresh._programs) == 1


def test_what_cannot_be_traced_is_named(renderer):
    with pytest.raises(ValueError, match="materials must be as many as the scene's 1"):
        renderer.trace(BALL, CAMERA, LIGHTS, [GLASS, GLASS])
    with pytest.raises(ValueError, match="background must be red, green and blue"):
        renderer.trace(BALL, CAMERA, LIGHTS, background=((0, 0, 0), (1, 1, 1)))
    lens = ij.PinholeCamera(54.0, 54.0, 31.5, 23.5, 64, 48, (0.1, 0, 0, 0, 0))
    with pytest.raises(ValueError, match="camera must have no lens"):
        renderer.trace(BALL, lens, LIGHTS)
