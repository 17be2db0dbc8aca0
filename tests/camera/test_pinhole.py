import cv2
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.camera.pinhole import PinholeCamera
from tests.cases import CAMERAS


def camera_with(**changes):
    settings = {"fx": 60.0, "fy": 62.0, "cx": 31.5, "cy": 23.0}
    return PinholeCamera(**{**settings, "width": 64, "height": 48, **changes})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fx": 0}, "fx must be a positive number in pixels, got 0"),
        ({"fy": -1.0}, "fy must be a positive number"),
        ({"fx": np.nan}, "fx must be a positive number in pixels, got nan"),
        ({"cx": np.inf}, "cx must be a finite number"),
        ({"cy": "left"}, "cy must be a finite number in pixels, got 'left'"),
        ({"width": 0}, "width must be a whole number of at least 1 pixels, got 0"),
        ({"height": 4.5}, "height must be a whole number of at least 1 pixels"),
        ({"distortion": (0.1, 0.2)}, "distortion must have 5 or 8 or 14 coefficients"),
        ({"distortion": (0.1,) * 5, "fisheye": True}, "distortion must have 4"),
        ({"distortion": (np.nan,) * 5}, "distortion must be finite"),
        ({"camera_from_world": np.ones((3, 3))}, "matrix must be numbers of shape"),
    ],
)
def test_bad_field_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        camera_with(**changes)


def test_no_distortion_and_zero_distortion_are_the_same_camera():
    assert camera_with(distortion=(0.0,) * 5).ray_field is None
    assert camera_with().ray_field is None


@pytest.mark.parametrize("name", ["distorted", "rational", "tilted", "fisheye"])
@pytest.mark.usefixtures("double")
def test_projection_is_that_of_opencv(name):
    camera = CAMERAS[name]()
    points = np.random.default_rng(0).uniform(
        (-0.4, -0.3, 0.9), (0.4, 0.3, 1.5), (9, 3)
    )
    project = cv2.fisheye.projectPoints if camera.fisheye else cv2.projectPoints
    arguments = (np.zeros(3), np.zeros(3), camera.matrix())
    expected, _ = project(
        points[:, None], *arguments, np.asarray(camera.distortion, float)
    )
    found = camera.project(jnp.asarray(points))
    np.testing.assert_allclose(found, expected[:, 0], atol=1e-9)


def test_pixels_beyond_the_lens_see_nothing():
    # A barrel this strong folds over inside the image.
    camera = camera_with(fx=30.0, fy=30.0, distortion=(-0.5, 0.0, 0.0, 0.0, 0.0))
    row, col = camera.frame.pixels()
    sees = np.asarray(camera.sees(row, col))
    assert sees[23, 31]
    assert not sees[0, 0]
    rays = camera.rays(row, col, np.float32)
    assert np.isfinite(np.asarray(rays.direction.stack())).all()


def test_intrinsics_may_be_traced():
    def column(fx):
        camera = camera_with(fx=fx)
        return camera.rays(jnp.array(3), jnp.array(40), fx.dtype).direction.x

    value, slope = jax.jit(jax.value_and_grad(column))(jnp.asarray(50.0))
    assert float(value) == pytest.approx(8.5 / 50)
    assert float(slope) == pytest.approx(-8.5 / 50**2)


def test_traced_intrinsics_with_a_lens_are_refused():
    with pytest.raises(ValueError, match="must be made from concrete numbers"):
        jax.jit(lambda fx: camera_with(fx=fx, distortion=(0.1,) * 5).fx)(50.0)
