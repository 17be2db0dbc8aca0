"""Billboards hold what is seen of a primitive, and little else."""

import cv2
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.glsl import offscreen
from impostor_jax.glsl.draw_list import draw_list_of
from impostor_jax.glsl.program import shader_sources

pytest.importorskip("moderngl")


def filled(renderer, primitive, camera):
    """Pixels of the billboard, all of it filled."""
    draws = draw_list_of(primitive, camera)
    (call,) = draws.calls
    vertex, _ = shader_sources(call.impostor, "330", draws.orthographic)
    fill = "#version 330 core\nout vec4 color;\nvoid main() { color = vec4(1.0); }\n"
    size = (camera.width, camera.height)
    with renderer._context as context:
        program = context.program(vertex_shader=vertex, fragment_shader=fill)
        for name, value in draws.uniforms.items():
            if name in program:
                program[name].value = value
        buffer = context.buffer(call.rows.tobytes())
        layout, names = offscreen._layout(call.impostor, program)
        array = context.vertex_array(program, [(buffer, layout, *names)])
        target = context.texture(size, 4, dtype="f4")
        frame = context.framebuffer([target])
        frame.use()
        context.disable(context.DEPTH_TEST)
        frame.clear(0, 0, 0, 0)
        array.render(context.TRIANGLE_STRIP, vertices=4, instances=1)
        color = np.frombuffer(target.read(), np.float32).reshape(*size[::-1], 4)
        for used in (frame, target, array, buffer, program):
            used.release()
    return color[::-1, :, 0] > 0


def check_tight(mask, billboard, along):
    """Hold the rectangle to end, in its own directions, where the outline does."""
    assert mask.any()
    assert not (mask & ~billboard).any()
    along = along / np.linalg.norm(along)
    for direction in (along, (-along[1], along[0])):
        rows, cols = np.indices(mask.shape)
        place = cols * direction[0] + rows * direction[1]
        assert place[billboard].max() - place[mask].max() < 1.5
        assert place[mask].min() - place[billboard].min() < 1.5


def camera_with(focal, orthographic):
    make = ij.OrthographicCamera if orthographic else ij.PinholeCamera
    return make(focal, focal, 79.5, 59.5, 160, 120)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("axis", [(0.6, 0.7, 0.3), (1, 0, 0), (0.05, 0.02, 1)])
def test_billboard_is_tight_to_the_outline(renderer, orthographic, axis):
    camera = camera_with(250.0, orthographic)
    rod = ij.Cylinder((0.02, -0.03, 0.9), axis, 0.04, 0.3)
    mask = renderer.draw(rod, camera).mask
    a, c = np.asarray(rod.axis), np.asarray(rod.center)
    along = a[:2] if orthographic else a[:2] * c[2] - c[:2] * a[2]
    check_tight(mask, filled(renderer, rod, camera), along)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize(
    ("center", "radius", "focal"),
    [
        pytest.param((0.0, 0.0, 0.9), 0.1, 250.0, id="on the axis"),
        pytest.param((0.06, -0.04, 0.5), 0.08, 250.0, id="off the axis"),
        pytest.param((0.4, 0.2, 0.5), 0.1, 60.0, id="far off the axis"),
        pytest.param((0.01, 0.005, 0.11), 0.07, 60.0, id="near"),
    ],
)
def test_billboard_of_a_sphere_is_tight_to_the_cone_of_its_tangents(
    renderer, orthographic, center, radius, focal
):
    camera = camera_with(focal, orthographic)
    ball = ij.Sphere(center, radius)
    mask = renderer.draw(ball, camera).mask
    along = np.array(center[:2]) if any(center[:2]) else np.array([1.0, 0.0])
    check_tight(mask, filled(renderer, ball, camera), along)


def test_billboard_of_a_sphere_around_or_beside_the_camera_is_the_whole_image(renderer):
    camera = camera_with(250.0, orthographic=False)
    for center in ((0.0, 0.0, 0.0), (0.3, -0.2, 0.4), (0.9, 0.8, 0.5)):
        assert filled(renderer, ij.Sphere(center, 1.0), camera).all()


def seen_along(way, center, orthographic):
    """Direction in the image of a way at a center."""
    way, center = np.asarray(way), np.asarray(center)
    return way[:2] if orthographic else way[:2] * center[2] - center[:2] * way[2]


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("radii", [(0.06, 0.03), (0.02, 0.07)])
@pytest.mark.parametrize("way", [(0.1, 0.12, 0.05), (0.02, -0.01, 0.15)])
def test_billboard_of_a_frustum_is_tight_to_its_two_ends(
    renderer, orthographic, radii, way
):
    camera, center = camera_with(250.0, orthographic), np.array([0.03, -0.02, 0.7])
    way = np.array(way)
    cup = ij.Frustum(center - way / 2, center + way / 2, *radii)
    mask = renderer.draw(cup, camera).mask
    along = seen_along(way, center, orthographic)
    check_tight(mask, filled(renderer, cup, camera), along)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.4), (0.2, 0.1, 0.4)])
def test_billboard_of_a_box_is_tight_to_its_corners(renderer, orthographic, turn):
    camera, center = camera_with(250.0, orthographic), np.array([0.03, -0.02, 0.7])
    rotation = cv2.Rodrigues(np.array(turn))[0]
    box = ij.Box(center, rotation, (0.2, 0.1, 0.08))
    mask = renderer.draw(box, camera).mask
    along = seen_along(rotation[:, 0], center, orthographic)
    check_tight(mask, filled(renderer, box, camera), along)


@pytest.mark.parametrize("orthographic", [False, True])
def test_billboard_of_a_triangle_is_tight_to_its_corners(renderer, orthographic):
    camera = camera_with(250.0, orthographic)
    corners = np.array([(-0.1, -0.05, 0.6), (0.12, 0.06, 0.8), (-0.02, 0.09, 0.7)])
    triangle = ij.Triangle(corners)
    billboard = filled(renderer, triangle, camera)
    assert not (renderer.draw(triangle, camera).mask & ~billboard).any()
    # To the corners themselves: a tip is narrower than the pixels.
    seen = corners[:, :2] if orthographic else corners[:, :2] / corners[:, 2:]
    seen = 250.0 * seen + (79.5, 59.5)
    x, y = (seen[1] - seen[0]) / np.linalg.norm(seen[1] - seen[0])
    pixels = np.argwhere(billboard)[:, ::-1]
    for direction in ((x, y), (-y, x)):
        place, ends = pixels @ direction, seen @ direction
        assert abs(place.max() - ends.max()) < 1.5
        assert abs(place.min() - ends.min()) < 1.5


@pytest.mark.parametrize(
    "shape",
    [
        pytest.param(ij.Frustum((0, 0, 0.5), (0.1, 0, -0.2), 0.1, 0.2), id="frustum"),
        pytest.param(ij.Box((0, 0.1, 0.2), np.eye(3), (1, 1, 1)), id="box"),
        pytest.param(ij.Triangle([(-1, 0, 1), (1, 0, 1), (0, 1, -1)]), id="triangle"),
    ],
)
def test_billboard_of_what_reaches_behind_the_camera_is_the_whole_image(
    renderer, shape
):
    assert filled(renderer, shape, camera_with(250.0, orthographic=False)).all()
