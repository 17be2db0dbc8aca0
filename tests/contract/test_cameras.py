"""What every camera promises."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from impostor_jax.numerics import eps
from impostor_jax.rendering.bounds import ray_coordinates
from tests.cases import CAMERAS
from tests.checks import all_finite
from tests.groups import FULL, RELEASE


@pytest.fixture(params=CAMERAS)
def camera(request, dtype):
    return CAMERAS[request.param]()


def seen_rays(camera, dtype):
    """Rays of all pixels, and which pixels see anything."""
    row, col = camera.frame.pixels()
    sees = camera.sees(row, col)
    sees = np.ones(row.shape, bool) if sees is None else np.asarray(sees)
    return camera.rays(row, col, dtype), sees


@FULL
def test_a_ray_projects_to_its_own_pixel(camera, dtype):
    rays, sees = seen_rays(camera, dtype)
    assert sees.mean() > 0.9
    points = rays.at(jnp.ones(sees.shape, dtype)).stack()
    row, col = camera.frame.pixels()
    pixels = np.asarray(camera.project(points))
    expected = np.stack([col, row], axis=-1)
    error = np.abs(pixels - expected)[sees].max()
    assert error < eps(dtype, 32) * camera.width


def test_rays_have_unit_depth_or_range_and_start_at_the_camera(camera, dtype):
    ray, _ = seen_rays(camera, dtype)
    if camera.projection == "spherical":
        length = np.asarray(ray.direction.norm())
        np.testing.assert_allclose(length, 1, rtol=eps(dtype, 2))
    else:
        assert (np.asarray(ray.direction.z) == 1).all()
    assert not np.asarray(ray.origin.z).any()
    assert np.asarray(ray.origin.stack()).any() != camera.is_central
    assert ray.direction.x.dtype == dtype


def test_box_of_pixels_holds_exactly_the_rays_of_a_box(camera, dtype):
    rays, sees = seen_rays(camera, dtype)
    low, high = np.array([-0.21, -0.13], dtype), np.array([0.3, 0.17], dtype)
    places = np.stack(ray_coordinates(rays, camera.projection), axis=-1)
    inside = ((places >= low) & (places <= high)).all(-1)
    rows, cols = np.nonzero(inside & sees)
    box = camera.pixel_box(jnp.asarray(low), jnp.asarray(high))
    assert (int(box.first_row), int(box.last_row)) == (rows.min(), rows.max())
    assert (int(box.first_col), int(box.last_col)) == (cols.min(), cols.max())


@FULL
@pytest.mark.parametrize(
    "name",
    [
        # A tilted lens has all coefficients that these have.
        *(pytest.param(name, marks=RELEASE) for name in ("distorted", "rational")),
        *(sorted(set(CAMERAS) - {"distorted", "rational", "spherical"})),
    ],
)
@pytest.mark.usefixtures("double")
def test_rays_differentiate_in_the_intrinsics(name):
    camera = CAMERAS[name]()
    row, col = jnp.array([3, 24, 40]), jnp.array([50, 31, 6])

    @jax.jit
    def directions(camera):
        # Parallel rays differ in where they start.
        ray = camera.rays(row, col, np.float64)
        return (ray.direction if camera.is_central else ray.origin).stack()

    derivative = jax.jacfwd(directions)(camera)
    assert all_finite(derivative)
    step = 1e-5
    make = type(camera)
    settings = {
        key: getattr(camera, key)
        for key in ("fx", "fy", "cx", "cy", "distortion", "fisheye")
        if hasattr(camera, key)
    }
    for key in ("fx", "fy", "cx", "cy"):
        sides = [
            directions(
                make(
                    **{**settings, key: settings[key] + sign * step},
                    width=camera.width,
                    height=camera.height,
                )
            )
            for sign in (1, -1)
        ]
        numeric = (sides[0] - sides[1]) / (2 * step)
        np.testing.assert_allclose(getattr(derivative, key), numeric, atol=1e-9)
    if settings.get("distortion") is not None:
        for index in range(camera.distortion.shape[0]):
            sides = []
            for sign in (1, -1):
                changed = camera.distortion.at[index].add(sign * step)
                values = {**settings, "distortion": changed}
                sides.append(
                    directions(make(**values, width=camera.width, height=camera.height))
                )
            numeric = (sides[0] - sides[1]) / (2 * step)
            found = derivative.distortion[..., index]
            np.testing.assert_allclose(found, numeric, atol=1e-8)
