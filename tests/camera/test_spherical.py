import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.numerics import eps
from impostor_jax.sensor.base import cos_incidence
from tests.cases import CAMERAS
from tests.checks import all_finite

CAMERA = ij.SphericalCamera.regular(96, 24, 1.2, -1.2)


def angles(camera):
    """Azimuth and elevation of each pixel."""
    return np.meshgrid(np.asarray(camera.azimuth), np.asarray(camera.elevation))


def nearest_of(shapes, camera):
    """Range and index of what is nearest, every shape rendered alone."""
    depth = np.array([ij.render(s, camera, ("depth",)).depth for s in shapes])
    index = np.where(np.isfinite(depth.min(axis=0)), depth.argmin(axis=0), -1)
    return depth.min(axis=0), index


def test_frame_is_right_down_forward():
    camera = ij.SphericalCamera(np.radians([90, 30, -90]), np.radians([-90, 0, 90]))
    row, col = jnp.array([0, 1, 1, 1, 2]), jnp.array([1, 0, 1, 2, 1])
    found = camera.rays(row, col, np.float32).direction.stack()
    s, c = 0.5, np.sqrt(0.75)
    expected = [(0, -1, 0), (-c, -s, 0), (0, -s, c), (c, -s, 0), (0, 1, 0)]
    np.testing.assert_allclose(found, expected, atol=1e-7)


def test_range_of_a_sphere_around_the_scanner_is_its_radius(dtype):
    # Off the origin by 1 m upward: of a ray up at e, r^2 = t^2 - 2 t sin e + 1.
    ball = ij.Sphere(np.array((0, -1, 0), dtype), np.asarray(30, dtype))
    maps = ij.render(ball, CAMERA, ("depth", "range", "normal", "point"))
    e = angles(CAMERA)[1]
    expected = np.sin(e) + np.sqrt(np.sin(e) ** 2 + 30**2 - 1)
    np.testing.assert_allclose(maps.depth, expected, rtol=eps(dtype, 4))
    np.testing.assert_allclose(maps.range, maps.depth, rtol=eps(dtype, 4))
    point = np.asarray(maps.point)
    assert (point[..., 2] < -20).any(), "behind"
    inward = ((0, -1, 0) - point) / 30
    np.testing.assert_allclose(maps.normal, inward, atol=eps(dtype, 4))


def test_upright_wall_all_around_is_seen_at_its_radius_over_the_cosine(dtype):
    pipe = ij.Cylinder(*(np.asarray(v, dtype) for v in ((0, 0, 0), (0, 1, 0), 5, 80)))
    depth = ij.render(pipe, CAMERA, ("depth",)).depth
    expected = 5 / np.cos(angles(CAMERA)[1])
    np.testing.assert_allclose(depth, expected, rtol=eps(dtype, 8))


@pytest.mark.usefixtures("double")
def test_single_precision_keeps_ranges_at_30_m():
    # Of the same rays: the error of depth with given directions, not of the angles.
    camera = ij.SphericalCamera.regular(2048, 16, 0.2, -0.05)
    stem = ij.Cylinder((12.0, -5.0, -27.0), (0.1, 1, 0.05), 0.2, 14.0)
    row, col = camera.frame.pixels()
    single = camera.rays(row, col, np.float32)
    double = jax.tree.map(lambda x: x.astype(np.float64), single)
    exact = np.asarray(stem.intersect(double).t)
    rounded = jax.tree.map(lambda x: x.astype(np.float32), stem).intersect(single).t
    both = np.isfinite(exact) & np.isfinite(np.asarray(rounded))
    assert both.sum() > 60
    assert (np.isfinite(exact) ^ np.isfinite(np.asarray(rounded))).sum() <= 2
    error = np.abs(np.asarray(rounded)[both] - exact[both])
    assert 25 < exact[both].min() < 35
    # One spacing of numbers near 30 m is 1.9 um; a grazing ray loses more.
    assert np.median(error) < 4e-6
    assert error.max() < 1e-3


@pytest.mark.parametrize("start", [-np.pi, 0.4, -6.0])
def test_scene_all_around_is_that_of_its_shapes_alone(start):
    # Of any first column: the seam is at the image's ends, or within it; some shapes
    # lie on it, above and below the scanner, or around it.
    azimuth = start + (np.arange(96) + 0.5) * (2 * np.pi / 96)
    camera = ij.SphericalCamera(np.linspace(-1.57, 1.5, 24), azimuth)
    rng = np.random.default_rng(1)
    centers = rng.normal(size=(12, 3)) * (4, 1.5, 4)
    centers[:4] = [(0, 0.3, -4), (0.02, -3, 0.01), (-0.05, 3, -0.1), (0.1, 0, -6)]
    balls = [ij.Sphere(c, 0.4) for c in centers]
    stems = [ij.Cylinder(c + 0.7, (0.2, 1, 0.1), 0.2, 5.0) for c in centers[3:]]
    around = [
        ij.Cylinder((0, 0, 0), (0, 1, 0), 9.0, 2.0),
        ij.Plane((0, 4, 0), (0, -1, 0)),
    ]
    shapes = [*balls, *stems, *around]
    maps = ij.render(ij.Scene(shapes), camera, ("depth", "index"))
    depth, index = nearest_of(shapes, camera)
    assert len(np.unique(index)) > 14
    np.testing.assert_array_equal(maps.index, index)
    np.testing.assert_allclose(maps.depth, depth, rtol=eps("float32", 16))


@pytest.mark.parametrize("center", [
    (0.5, -0.2, 3.0), (0.3, 0.1, -4.0), (-4.0, 1.0, -0.5), (0.1, -3.0, 0.2), (0, 2, 0),
])  # fmt: skip
def test_tile_shows_all_of_a_shape(center):
    stem = ij.Cylinder(center, (0.3, 0.8, 0.2), 0.4, 2.0)
    whole, part = (
        ij.render(stem, CAMERA, ("mask", "depth"), effort=ij.Effort(extent=extent))
        for extent in ("frame", "tile")
    )
    assert whole.mask.any()
    np.testing.assert_array_equal(part.mask, whole.mask)
    np.testing.assert_allclose(part.depth, whole.depth, rtol=1e-6)
    box = ij.outline_box(stem, CAMERA)
    rows = np.nonzero(np.asarray(whole.mask).any(axis=1))[0]
    assert int(box.last_row) - int(box.first_row) <= np.ptp(rows) + 6


def test_points_project_all_around_and_beyond_the_rows(dtype):
    camera = ij.SphericalCamera(
        np.radians([3, 1, 0, -4]), np.radians([170, 180, 190, 210]), None
    )
    back = np.array([(0, 0, -2), (-np.sin(np.radians(25)), 0, -np.cos(np.radians(25)))])
    up = np.array([(0, -np.sin(x), -np.cos(x)) for x in np.radians([2, 5, -6])])
    found = camera.project(jnp.asarray(np.concatenate([back, up]), dtype))
    expected = [(1, 2), (2.75, 2), (1, 0.5), (1, -1), (1, 3.5)]
    np.testing.assert_allclose(found, expected, atol=eps(dtype, 256))


@pytest.mark.parametrize("point", [(0, -1, 0), (0, 2, 0), (0, 0, 0), (1e-20, -1, 0)])
def test_projection_is_finite_at_the_poles(point):
    camera = CAMERAS["spherical"]()
    point = jnp.array(point, float)
    assert all_finite((camera.project(point), jax.jacfwd(camera.project)(point)))


def test_a_single_row_projects_a_radian_a_pixel():
    camera = ij.SphericalCamera([0.1], np.linspace(-1, 1, 5))
    found = camera.project(jnp.array([0.0, -np.sin(0.3), np.cos(0.3)]))
    np.testing.assert_allclose(found, (2.0, 0.2), atol=1e-6)


def test_strided_camera_makes_the_images_of_that_stride():
    camera, stem = CAMERAS["spherical"](), ij.Cylinder((0, 0, -3), (0, 1, 0), 0.5, 4.0)
    coarse = ij.render(stem, camera.strided(3), ("depth",)).depth
    strided = ij.render(stem, camera, ("depth",), effort=ij.Effort(stride=3)).depth
    assert np.isfinite(coarse).sum() > 10
    np.testing.assert_array_equal(coarse, strided)


@pytest.mark.usefixtures("double")
def test_range_differentiates_in_the_shape_and_in_the_angles():
    stem = ij.Cylinder((1.0, 0.3, -3.0), (0.1, 1, 0.2), 0.4, 4.0)

    @jax.jit
    def total(shift):
        camera = ij.SphericalCamera(
            jnp.linspace(0.3, -0.3, 8) + shift[0], jnp.linspace(2.6, 3.0, 8) + shift[1]
        )
        moved = ij.Cylinder(stem.center + shift[2:], stem.axis, stem.radius, 4.0)
        return jnp.sum(ij.render(moved, camera, ("depth",), miss=0.0).depth)

    start, step = jnp.zeros(5), 1e-6 * jnp.eye(5)
    gradient = jax.grad(total)(start)
    numeric = [(total(s) - total(-s)) / 2e-6 for s in step]
    assert np.abs(gradient).min() > 0.1
    np.testing.assert_allclose(gradient, numeric, rtol=1e-6)


def test_silhouettes_are_those_of_shapes_alone():
    stems = ij.Cylinder(
        np.array([(0.5, 0, -4.0), (0.0, 0, -9.0), (3.0, -1, 0.5)]),
        np.array([(0.1, 1, 0)] * 3), np.full(3, 0.5), np.full(3, 3.0),
    )  # fmt: skip
    found = ij.silhouettes(stems, CAMERA)
    for k in range(3):
        stem = jax.tree.map(lambda x, k=k: x[k], stems)
        mask = ij.render(stem, CAMERA, ("mask",)).mask
        np.testing.assert_array_equal(found.mask[k], mask)
        assert found.count[k] == mask.sum() > 0
    with pytest.raises(ValueError, match="camera must see the plane z = 1"):
        ij.silhouettes(stems, CAMERA, margin=(1, 1))


def test_traced_picture_shows_a_shadow_behind_the_scanner():
    scene = ij.Scene([ij.Plane((0, 1, 0), (0, -1, 0)), ij.Sphere((0, 0, -2), 0.5)])
    light = ij.DirectionalLight((0, -1, 0), 1.0)
    picture = np.asarray(ij.trace(scene, CAMERA, [light]))[..., 0]
    index = np.asarray(ij.render(scene, CAMERA, ("index",)).index)
    point = np.asarray(ij.render(scene, CAMERA, ("point",)).point)
    beneath = (index == 0) & (np.hypot(point[..., 0], point[..., 2] + 2) < 0.45)
    assert beneath.sum() > 3
    assert not picture[beneath].any()
    assert picture[(index == 0) & ~beneath].max() > 0.9


def test_beams_of_a_table_are_in_degrees():
    camera = ij.SphericalCamera.of_beams([2.0, 0.5, -8.0], 4)
    np.testing.assert_allclose(np.degrees(camera.elevation), [2.0, 0.5, -8.0])
    np.testing.assert_allclose(np.degrees(camera.azimuth), [-135, -45, 45, 135])


def test_what_needs_a_plane_refuses_the_camera():
    shape, depth = ij.Cylinder((0, 0, 2), (0, 1, 0), 0.1, 0.3), np.ones((24, 96))
    message = "camera must see the plane z = 1 from a center.*SphericalCamera"
    with pytest.raises(ValueError, match=message):
        ij.coverage(shape, CAMERA)
    with pytest.raises(ValueError, match=message):
        ij.signed_distance(shape, CAMERA, jnp.zeros((1, 2)))
    with pytest.raises(ValueError, match="samples of 1 for a SphericalCamera"):
        ij.render(shape, CAMERA, ("coverage",), effort=ij.Effort(samples=2))
    with pytest.raises(
        ValueError, match='edges must be "hard" for a camera with a lens or a Spherical'
    ):
        ij.trace(shape, CAMERA, [ij.AmbientLight(1.0)], edges="area")
    with pytest.raises(ValueError, match="SphericalCamera, whose depth is the range"):
        ij.calibrate_sensor([depth], CAMERA)


@pytest.mark.parametrize("sensor", [
    ij.StereoDisparity(525.0), ij.StructuredLight(),
    ij.MatchingWindow(ij.ConstantNoise(0.002)),
])  # fmt: skip
def test_sensors_of_images_in_a_plane_refuse_the_camera(sensor):
    depth, normal = jnp.ones((24, 96)), jnp.zeros((24, 96, 3)).at[..., 2].set(-1.0)
    with pytest.raises(ValueError, match="SphericalCamera, whose depth is the range"):
        sensor.sample(jax.random.key(0), depth, normal, CAMERA)


def test_noise_is_along_the_ray_and_knows_the_incidence():
    pipe = ij.Cylinder((0, 0, 0), (0, 1, 0), 5.0, 80.0)
    maps = ij.render(pipe, CAMERA)
    cosine = cos_incidence(maps.normal, CAMERA)
    np.testing.assert_allclose(cosine, np.cos(angles(CAMERA)[1]), atol=1e-6)
    sensor = ij.LateralNoise(ij.Dropout(ij.TimeOfFlight(), rate=0.1))
    depth = sensor.sample(jax.random.key(0), maps.depth, maps.normal, CAMERA)
    assert 0.05 < (np.asarray(depth) == 0).mean() < 0.6
    spread = ij.ConstantNoise(0.01).sample(
        jax.random.key(0), maps.depth, maps.normal, CAMERA
    )
    # Of 2304 readings, known to 1.5 %.
    assert np.std(spread - maps.depth) == pytest.approx(0.01, rel=0.06)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ij.SphericalCamera([0, 0.1, 0.1], [0, 1]), "elevation must rise stri"),
        (lambda: ij.SphericalCamera([0, 0.1], [0, 1, 0.5]), "azimuth must rise strict"),
        (lambda: ij.SphericalCamera([0, 2.0], [0, 1]), "elevation must be from -pi/2"),
        (lambda: ij.SphericalCamera([0, 1.0], [-4, 4]), "azimuth must span one turn"),
        (lambda: ij.SphericalCamera([], [0, 1]), "elevation must be radians of shape"),
        (lambda: ij.SphericalCamera([[0.0]], [0, 1]), "elevation must be radians of"),
        (lambda: ij.SphericalCamera(["a"], [0, 1]), "elevation must be radians of sha"),
        (lambda: ij.SphericalCamera.regular(8, 4, -1, 1), "fov_up must be above fov_d"),
        (lambda: ij.SphericalCamera.regular(8, 0, 1, -1), "height must be a whole num"),
        (lambda: ij.SphericalCamera.of_beams([1, 1], 8), "elevation_deg must rise str"),
    ],
)
def test_bad_tables_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
