"""Cameras of OpenGL's matrices, against what its pipeline does with points."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij

SIZE = (64, 48)
SWAPPED = np.eye(4)[[1, 0, 2, 3]]


def frustum(left, right, bottom, top, near, far):
    """The matrix of glFrustum, as its manual page has it."""
    width, height, length = right - left, top - bottom, far - near
    return np.array([
        [2 * near / width, 0, (right + left) / width, 0],
        [0, 2 * near / height, (top + bottom) / height, 0],
        [0, 0, -(far + near) / length, -2 * far * near / length],
        [0, 0, -1, 0],
    ])  # fmt: skip


def ortho(left, right, bottom, top, near, far):
    """The matrix of glOrtho, as its manual page has it."""
    width, height, length = right - left, top - bottom, far - near
    return np.array([
        [2 / width, 0, 0, -(right + left) / width],
        [0, 2 / height, 0, -(top + bottom) / height],
        [0, 0, -2 / length, -(far + near) / length],
        [0, 0, 0, 1],
    ])  # fmt: skip


def drawn_at(projection, view, points):
    """Where OpenGL draws points: columns and rows from the top left pixel's center."""
    points = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    clip = points @ (projection @ view).T
    window = (clip[:, :2] / clip[:, 3:] + 1) / 2 * SIZE
    return np.stack([window[:, 0], SIZE[1] - window[:, 1]], axis=1) - 0.5


def look_at():
    """A view matrix: from (0.5, 1, 2) towards the origin, y up."""
    eye = np.array([0.5, 1.0, 2.0])
    z = eye / np.linalg.norm(eye)
    x = np.cross([0, 1, 0], z) / np.linalg.norm(np.cross([0, 1, 0], z))
    view = np.eye(4)
    view[:3, :3] = x, np.cross(z, x), z
    view[:3, 3] = -view[:3, :3] @ eye
    return view


CAMERAS = pytest.mark.parametrize(
    ("made", "projection"),
    [
        (ij.PinholeCamera, frustum(-0.3, 0.5, -0.2, 0.3, 0.4, 5.0)),
        (ij.OrthographicCamera, ortho(-1.0, 1.4, -0.7, 1.2, 0.1, 6.0)),
    ],
)


@CAMERAS
@pytest.mark.usefixtures("double")
def test_a_point_is_seen_where_opengl_draws_it(made, projection):
    points = np.random.default_rng(0).uniform(-0.4, 0.4, (9, 3))
    camera = made.from_opengl(projection, SIZE, look_at())
    assert (camera.width, camera.height) == SIZE
    found = camera.project(camera.camera_from_world.apply(points))
    expected = drawn_at(projection, look_at(), points)
    np.testing.assert_allclose(found, expected, atol=1e-11)


@CAMERAS
def test_without_a_view_the_camera_frame_is_the_world(made, projection):
    camera = made.from_opengl(projection, SIZE)
    assert camera.camera_from_world is None
    points = np.array([[0.1, 0.2, 1.0], [-0.2, -0.1, 2.0]])
    expected = drawn_at(projection, np.diag([1.0, -1, -1, 1]), points)
    np.testing.assert_allclose(camera.project(points), expected, rtol=1e-5)


def test_a_matrix_and_a_view_may_be_traced():
    projection = frustum(-0.3, 0.5, -0.2, 0.3, 0.4, 5.0)
    point = np.array([0.1, -0.2, 0.3])

    def seen(made, projection, view):
        camera = made.from_opengl(projection, SIZE, view)
        return camera.project(camera.camera_from_world.apply(jnp.asarray(point)))

    for made, given in (
        (ij.PinholeCamera, projection),
        (ij.OrthographicCamera, ortho(-1.0, 1.4, -0.7, 1.2, 0.1, 6.0)),
    ):
        traced = jax.jit(lambda p, v, made=made: seen(made, p, v))
        found = traced(jnp.asarray(given), jnp.asarray(look_at()))
        expected = drawn_at(given, look_at(), point[None])[0]
        np.testing.assert_allclose(found, expected, rtol=1e-5)


def endless(near):
    """A matrix of a perspective that has no far plane."""
    matrix = frustum(-0.3, 0.3, -0.2, 0.2, near, 2 * near)
    matrix[2] = 0, 0, -1, -2 * near
    return matrix


def zero_to_one(near, far):
    matrix = frustum(-0.3, 0.3, -0.2, 0.2, near, far)
    matrix[2] = 0, 0, -far / (far - near), -far * near / (far - near)
    return matrix


@pytest.mark.parametrize(
    ("projection", "ndc", "expected"),
    [
        (frustum(-0.3, 0.5, -0.2, 0.3, 0.4, 5.0), (-1, 1), (0.4, 5.0)),
        (ortho(-1, 1, -1, 1, 0.25, 6.0), (-1, 1), (0.25, 6.0)),
        (ortho(-1, 1, -1, 1, -1.0, 1.0), (-1, 1), (-1.0, 1.0)),
        (endless(0.4), (-1, 1), (0.4, np.inf)),
        (zero_to_one(0.4, 5.0), (0, 1), (0.4, 5.0)),
        (zero_to_one(5.0, 0.4), (1, 0), (0.4, 5.0)),
    ],
)
def test_near_and_far_are_those_of_the_matrix(projection, ndc, expected):
    np.testing.assert_allclose(ij.near_far_of(projection, ndc), expected, rtol=1e-14)


def test_a_render_takes_them():
    projection = frustum(-0.3, 0.3, -0.2, 0.2, 0.5, 1.5)
    near, far = ij.near_far_of(projection)
    camera = ij.PinholeCamera.from_opengl(projection, SIZE)
    scene = ij.Scene(
        [ij.Sphere((0, 0, 0.4), 0.05), ij.Plane((0, 0, 1.2), (0.6, 0, -0.8))]
    )
    depth = np.asarray(ij.render(scene, camera, near=near, far=far).depth)
    assert 0.5 < depth.min() < 1.2
    assert 1.2 < depth[np.isfinite(depth)].max() < 1.5
    assert np.isinf(depth[:, -1]).any()
    assert np.isfinite(depth[24, 32])


@pytest.mark.parametrize(
    ("made", "projection", "size", "message"),
    [
        (ij.PinholeCamera, ortho(-1, 1, -1, 1, 1, 2), SIZE, "OrthographicCamera.from"),
        (
            ij.OrthographicCamera,
            frustum(-1, 1, -1, 1, 1, 2),
            SIZE,
            "PinholeCamera.from_opengl",
        ),
        (ij.PinholeCamera, frustum(-1, 1, -1, 1, 1, 2).T, SIZE, "transpose one of row"),
        (ij.OrthographicCamera, ortho(-1, 2, -1, 1, 1, 2).T, SIZE, "transpose one of"),
        (ij.PinholeCamera, -frustum(-1, 1, -1, 1, 1, 2), SIZE, "the row 0 0 -1 0"),
        (ij.PinholeCamera, frustum(1, -1, -1, 1, 1, 2), SIZE, "positive scales"),
        (ij.PinholeCamera, frustum(-1, 1, 1, -1, 1, 2), SIZE, "positive scales"),
        (
            ij.PinholeCamera,
            frustum(-1, 1, -1, 1, 1, 2) + 0.1 * SWAPPED * (1 - np.eye(4)),
            SIZE,
            "no skew",
        ),
        (ij.PinholeCamera, np.eye(3), SIZE, "projection must be numbers of shape"),
        (ij.PinholeCamera, np.ones((2, 4, 4)), SIZE, "projection must be one matrix"),
        (ij.PinholeCamera, np.full((4, 4), np.nan), SIZE, "projection must be finite"),
        (ij.PinholeCamera, frustum(-1, 1, -1, 1, 1, 2), 64, "size must be width and"),
        (ij.PinholeCamera, frustum(-1, 1, -1, 1, 1, 2), (64, 0), "height must be a"),
    ],
)
def test_what_is_no_camera_here_is_refused(made, projection, size, message):
    with pytest.raises(ValueError, match=message):
        made.from_opengl(projection, size)


def test_depths_that_are_in_no_order_or_oblique_are_refused():
    oblique = frustum(-1, 1, -1, 1, 1, 2)
    oblique[2, 0] = 0.1
    with pytest.raises(ValueError, match="planes across the view"):
        ij.near_far_of(oblique)
    with pytest.raises(ValueError, match="give others by ndc"):
        ij.near_far_of(zero_to_one(5.0, 0.4))
    with pytest.raises(ValueError, match="view must be numbers of shape"):
        ij.PinholeCamera.from_opengl(endless(1.0), SIZE, np.eye(3))
