"""What is true of the outline of a sphere, and of what is made from it."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import ConvexHull

import impostor_jax as ij
from impostor_jax.numerics import eps
from impostor_jax.rendering.bounds import image_bounds
from tests.cases import CAMERAS, pose
from tests.checks import all_finite
from tests.groups import FULL
from tests.rendering import exact
from tests.rendering.test_coverage import coverage_and_slopes, errors
from tests.rendering.test_distance import distance_and_slopes

# Center and radius. Wholly in front of the camera's plane z = 0: an ellipse.
ELLIPSES = {
    "in the middle": ((0.0, 0.0, 15.0), 5.0),
    "oblique": ((0.15, -0.1, 0.9), 0.2),
    "wide, beside the axis": ((0.05, 0.01, 0.5), 0.15),
    "small": ((0.2, 0.1, 2.0), 0.055),
    "smaller than a pixel": ((0.2, 0.1, 2.0), 0.01),
}
SPHERES = ELLIPSES | {
    "partly out of view": ((0.45, 0.1, 1.0), 0.3),
    "close": ((0.1, 0.3, 0.5), 0.4),
    "touching the plane z = 0: a parabola": ((0.3, 0.1, 0.25), 0.25),
    "partly behind the camera: a hyperbola": ((0.3, 0.2, 0.1), 0.3),
    "center behind the camera": ((0.3, 0.2, -0.05), 0.35),
    "nearly touching the camera": ((0.6, 0.0, 0.3), 0.67),
}


def silhouette(shape, camera=None, count=exact.VERTICES):
    """Vertices of the silhouette: at z = 1, or in pixels without a lens.

    The rays that touch, all at the angle asin(r / d) from the center, cut off in front
    of the camera.
    """
    center, radius = np.asarray(shape[0], float), shape[1]
    distance = np.linalg.norm(center)
    sine = radius / distance
    across = exact.tangents(center)
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)[:, None]
    ring = np.cos(angle) * across[0] + np.sin(angle) * across[1]
    rays = np.sqrt(1 - sine**2) * center / distance + sine * ring
    following = np.roll(rays, -1, 0)
    off, off_following = rays[:, 2:] - exact.NEAR, following[:, 2:] - exact.NEAR
    crosses = ((off < 0) != (off_following < 0))[:, 0]
    cuts = rays + off / np.where(off == off_following, 1, off - off_following) * (
        following - rays
    )
    rays = np.concatenate([rays[off[:, 0] >= 0], cuts[crosses]])
    image = rays[:, :2] / rays[:, 2:]
    if camera is not None:
        image = image * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    return image[ConvexHull(image).vertices]


@cache
def expected(name, camera_name="pinhole"):
    """Area in each pixel."""
    camera = CAMERAS[camera_name]()
    if camera.ray_field is None:
        return exact.coverage(silhouette(SPHERES[name], camera), camera)
    limit = 1.05 * np.abs([camera.ray_field.x, camera.ray_field.y]).max()
    polygon = exact.through_lens(silhouette(SPHERES[name]), camera, limit)
    return exact.coverage(polygon, camera)


def ellipse_area(values):
    """Area of the image of a sphere; `values` are x, y, z, r, fx and fy.

    The conic x^T Q x = 0 with Q = s I - c c^T, s = |c|^2 - r^2, has det Q = -s^2 r^2
    and the upper left minor m = s (z^2 - r^2). An ellipse's area is pi |det Q| / m^1.5.
    """
    x, y, z, r, fx, fy = values
    s = x * x + y * y + z * z - r * r
    return np.pi * fx * fy * r * r * np.sqrt(s) / (z * z - r * r) ** 1.5


def ellipse_slopes(values):
    values = np.array(values, float)
    steps = np.diag(1e-6 * (1 + np.abs(values)))
    return [
        (ellipse_area(values + s) - ellipse_area(values - s)) / (2 * s.sum())
        for s in steps
    ]


def at_pinhole(shape, weights=None):
    camera = CAMERAS["pinhole"]()
    # Traced, so that one compiled function serves all tests.
    fields = [jnp.asarray(getattr(camera, f)) for f in ("fx", "fy", "cx", "cy")]
    camera = eqx.tree_at(lambda c: [c.fx, c.fy, c.cx, c.cy], camera, fields)
    weights = np.ones((camera.height, camera.width)) if weights is None else weights
    return coverage_and_slopes(ij.Sphere(*shape), camera, jnp.asarray(weights, float))


def four(slopes):
    return np.array([*slopes.center, slopes.radius], float)


@FULL
@pytest.mark.parametrize("name", SPHERES)
def test_every_pixel_has_the_area_inside_the_outline(name, dtype):
    covered, *slopes = at_pinhole(SPHERES[name])
    assert covered.dtype == dtype
    error, edge = errors(covered, expected(name))
    assert edge.sum() > 1
    # Measured in both precisions: at most 1.04e-4, and 1.8e-4 in a pixel.
    assert error[edge].mean() < 1.5e-4
    assert error.max() < 3e-4
    assert all_finite(slopes)


@pytest.mark.parametrize("name", ELLIPSES)
def test_area_and_its_derivative_are_those_of_the_ellipse(name):
    center, radius = SPHERES[name]
    values = (*center, radius, 60.0, 62.0)
    covered, sphere, camera = at_pinhole(SPHERES[name])
    # Measured: 1.3e-5, of all that follows too; a chord cuts off what is outside it.
    assert float(covered.sum()) == pytest.approx(ellipse_area(values), rel=3e-5)
    found = [*four(sphere), float(camera.fx), float(camera.fy)]
    reference = np.array(ellipse_slopes(values))
    for part in (slice(0, 4), slice(4, 6)):
        scale = np.abs(reference[part]).max()
        np.testing.assert_allclose(found[part], reference[part], atol=3e-5 * scale)


def test_sphere_straight_ahead_is_a_disc(dtype):
    covered, *_ = at_pinhole(((0.0, 0.0, 15.0), 5.0))
    camera = CAMERAS["pinhole"]()
    tangent = 5 / np.sqrt(15**2 - 5**2)
    area = np.pi * camera.fx * camera.fy * tangent**2
    assert float(covered.sum()) == pytest.approx(area, rel=3e-5)
    outline = ij.outline(ij.Sphere((0, 0, 15), 5), camera)
    assert isinstance(outline, ij.SphereOutline)
    points = np.asarray(outline.points(40), float)
    image = points[:, :2] / points[:, 2:]
    np.testing.assert_allclose(np.linalg.norm(image, axis=1), tangent, rtol=1e-6)
    # Counterclockwise as one sees it, with y downwards.
    angle = np.unwrap(np.arctan2(-image[:, 1], image[:, 0]))
    np.testing.assert_allclose(np.diff(angle), 2 * np.pi / 40, rtol=1e-5)
    bounds = image_bounds(ij.Sphere((0, 0, 15), 5), "planar")
    reach = tangent + eps(dtype, 8) * (1 + tangent)
    for side, found in ((-1, bounds.low), (1, bounds.high)):
        np.testing.assert_allclose(found, side * reach, rtol=eps(dtype, 8))


@pytest.mark.parametrize("name", SPHERES)
def test_rays_touch_the_sphere_where_the_curve_is(name, dtype):
    shape = SPHERES[name]
    (center, radius), camera = shape, CAMERAS["pinhole"]()
    center = np.array(center)
    outline = ij.outline(ij.Sphere(*shape), camera)
    assert not bool(outline.inside)
    points = np.asarray(outline.points(50), float)
    within = eps(dtype, 16) * np.linalg.norm(center)
    radii = points - center
    np.testing.assert_allclose(np.linalg.norm(radii, axis=1), radius, atol=within)
    # The ray meets the radius at a right angle.
    leaning = np.sum(radii * points, axis=1)
    leaning /= radius + np.linalg.norm(points, axis=1)
    np.testing.assert_allclose(leaning, 0, atol=within)
    conic = np.asarray(outline.conic, float)
    residual = np.einsum("ni,ij,nj->n", points, conic, points)
    scale = np.abs(conic).max() * np.sum(points**2, axis=1)
    assert (np.abs(residual) < eps(dtype, 32) * scale).all()
    assert center @ conic @ center < 0
    bounds = image_bounds(ij.Sphere(*shape), "planar")
    low, high = bounds.low, bounds.high
    if name in ELLIPSES or name in ("partly out of view", "close"):
        polygon = silhouette(shape)
        np.testing.assert_allclose(low, polygon.min(0), atol=eps(dtype, 64) + 1e-6)
        np.testing.assert_allclose(high, polygon.max(0), atol=eps(dtype, 64) + 1e-6)
    else:
        assert np.isneginf(low).all()
        assert np.isposinf(high).all()


@FULL
@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("name", ["oblique", "small", "center behind the camera"])
def test_derivative_goes_to_the_pixels_that_the_outline_crosses(name):
    shape = SPHERES[name]
    u, v = np.meshgrid(np.linspace(0, 5, 64), np.linspace(1, 2, 48))
    weights = np.cos(u) * v
    _, slopes, _ = at_pinhole(shape, weights)
    values = np.array([*shape[0], shape[1]])
    numeric = []
    for step in 1e-5 * np.eye(4):
        change = 0
        for sign in (1, -1):
            *center, radius = values + sign * step
            polygon = silhouette((center, radius), CAMERAS["pinhole"]())
            change += sign * exact.coverage(polygon, CAMERAS["pinhole"]())
        numeric.append(np.sum(weights * change) / 2e-5)
    scale = np.abs(numeric).max()
    np.testing.assert_allclose(four(slopes), numeric, atol=1e-3 * scale)


@FULL
@pytest.mark.usefixtures("double")
def test_a_lens_bends_the_outline():
    camera = CAMERAS["distorted"]()
    cover = jax.jit(lambda sphere: ij.coverage(sphere, camera))
    for name in SPHERES:
        covered = cover(ij.Sphere(*SPHERES[name]))
        error, edge = errors(covered, expected(name, "distorted"))
        # Measured: at most 1.01e-4 and 1.7e-4, as without a lens.
        assert error[edge].mean() < 1.5e-4
        assert error.max() < 3e-4


def test_inside_is_covered_and_behind_is_not():
    for center in ((0, 0, 0), (0.1, 0.2, -0.3)):
        everywhere, *slopes = at_pinhole((center, 0.5))
        assert (np.asarray(everywhere) == 1).all()
        assert not four(slopes[0]).any()
        assert all_finite(slopes)
    # On the sphere, to the last bit.
    touching, *slopes = at_pinhole(((0.5, 0, 0), 0.5))
    assert all_finite((touching, slopes))
    for center in ((0.1, 0.1, -2.0), (3.0, 0.0, 0.3)):
        nowhere, *slopes = at_pinhole((center, 0.5))
        assert not np.asarray(nowhere).any()
        assert not four(slopes[0]).any()
        assert all_finite(slopes)


@FULL
def test_vmap_over_posed_spheres_with_tiles_and_forward_derivatives():
    camera = CAMERAS["posed"]()
    names = ("oblique", "small", "close")
    spheres = [ij.Sphere(*SPHERES[n]).transformed(pose().inverse()) for n in names]
    batch = jax.tree.map(lambda *fields: jnp.stack(fields), *spheres)
    grow = ij.Sphere((0, 0, 0), 1)

    @jax.jit
    @jax.vmap
    def block(sphere):
        tile = ij.outline_tile(sphere, camera, (32, 40), margin=1)
        covered, slope = jax.jvp(
            lambda s: ij.coverage(s, camera, tile), (sphere,), (grow,)
        )
        return covered, slope, tile.row, tile.col

    for name, covered, slope, row, col in zip(names, *block(batch), strict=True):
        part = expected(name)[row : row + 32, col : col + 40]
        error, edge = errors(covered, part)
        assert error[edge].mean() < 1.5e-4
        if name != "close":
            assert part.sum() == pytest.approx(expected(name).sum(), rel=1e-12)
            total = float(at_pinhole(SPHERES[name])[1].radius)
            assert float(slope.sum()) == pytest.approx(total, rel=1e-3)
    for function in (ij.coverage, ij.outline_box):
        with pytest.raises(ValueError, match="primitive must be a single one, got a"):
            function(batch, camera)


@FULL
@pytest.mark.parametrize("name", SPHERES)
def test_distance_is_that_of_the_silhouette(name, dtype):
    camera = CAMERAS["pinhole"]()
    polygon = silhouette(SPHERES[name], camera, 4000)
    points = np.random.default_rng(0).uniform((-10, -10), (74, 58), (100, 2))
    near = polygon[(np.abs(polygon - (32, 24)) < (40, 30)).all(1)]
    chosen = np.random.default_rng(1).integers(0, len(near), 100)
    noise = np.random.default_rng(2).normal(size=(100, 2)) * 0.01
    points = np.concatenate([points, near[chosen] + noise])
    points = points.astype(np.float32).astype(float)
    found, slopes, normal = distance_and_slopes(
        ij.Sphere(*SPHERES[name]), camera, jnp.asarray(points, dtype)
    )
    assert found.dtype == dtype
    reference = exact.signed_distance(polygon, points)
    np.testing.assert_allclose(found, reference, atol=1e-4 + eps(dtype, 1024))
    assert all_finite(slopes)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, rtol=eps(dtype, 32))


@FULL
@pytest.mark.usefixtures("double")
def test_derivative_of_the_distance_of_a_disc():
    camera = CAMERAS["pinhole"]()
    camera = eqx.tree_at(lambda c: c.fy, camera, camera.fx)
    sphere = ij.Sphere((0, 0, 15), 5)
    angle = np.linspace(0, 6, 200)
    toward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    away = np.linspace(0.2, 2, 200)[:, None]
    radius = 60 * 5 / np.sqrt(200)
    points = jnp.asarray([31.5, 23.0] + away * radius * toward)
    found, slopes, normal = distance_and_slopes(sphere, camera, points)
    np.testing.assert_allclose(found, radius * (away[:, 0] - 1), atol=1e-9)
    # Distances near the least are equal to rounding: the nearest point to its root.
    np.testing.assert_allclose(normal, toward, atol=2e-7)
    # f r / sqrt(d^2 - r^2) by r and by d, and the image of the center by x and y: the
    # circle is seen as from its own depth.
    cubed = np.sqrt(200) ** 3
    np.testing.assert_allclose(slopes.radius, -60 * 225 / cubed, rtol=1e-9)
    np.testing.assert_allclose(slopes.center[:, 2], 60 * 75 / cubed, rtol=1e-9)
    sideways = -60 * 15 / 200 * toward
    np.testing.assert_allclose(slopes.center[:, :2], sideways, atol=1e-6)


@FULL
def test_what_is_far_outside_the_image_has_a_positive_distance(dtype):
    points = np.random.default_rng(0).uniform((-10, -10), (74, 58), (200, 2))
    points = jnp.asarray(points, dtype)
    for center in ((24.5, 72.8, 7.7), (0.26, -32.2, 2.94), (5e3, 0, 1.0)):
        sphere = ij.Sphere(center, 1.0)
        found, *slopes = distance_and_slopes(sphere, CAMERAS["pinhole"](), points)
        assert (np.asarray(found) > 200).all()
        assert all_finite(slopes)


def test_without_an_outline_the_distance_is_infinite():
    camera, points = CAMERAS["pinhole"](), jnp.ones((200, 2))
    for center, reference in (((0, 0, 0.2), -np.inf), ((0, 0, -2), np.inf)):
        found, *slopes = distance_and_slopes(ij.Sphere(center, 0.5), camera, points)
        assert (np.asarray(found) == reference).all()
        assert all_finite(slopes)


@pytest.mark.parametrize("camera", ["pinhole", "distorted", "orthographic"])
@pytest.mark.parametrize("name", ["oblique", "small", "close"])
def test_tile_shows_all_of_the_sphere(name, camera):
    camera, sphere = CAMERAS[camera](), ij.Sphere(*SPHERES[name])
    mask = np.asarray(ij.render(sphere, camera, outputs=("mask",)).mask)
    rows, cols = np.nonzero(mask)
    box = ij.outline_box(sphere, camera)
    for first, last, seen in (
        (box.first_row, box.last_row, rows),
        (box.first_col, box.last_col, cols),
    ):
        # The outline's extreme point may fall between pixel centers.
        assert seen.min() - 2 <= int(first) <= seen.min()
        assert seen.max() <= int(last) <= seen.max() + 2
    tile = ij.outline_tile(sphere, camera)
    assert tile.height == camera.height or tile.height % 16 == 0
    row, col = tile.pixels()
    assert mask[row, col].sum() == mask.sum()


def test_other_shapes_are_refused():
    camera, box = CAMERAS["pinhole"](), ij.Box((0, 0, 1), np.eye(3), (0.1, 0.2, 0.3))
    message = "primitive must be a Cylinder or a Sphere to have an outline.*got a Box"
    with pytest.raises(ValueError, match=message):
        ij.outline(box, camera)
    with pytest.raises(ValueError, match=message):
        ij.coverage(box, camera)
    with pytest.raises(ValueError, match=message):
        ij.signed_distance(box, camera, jnp.zeros((1, 2)))
    sphere, parallel = ij.Sphere((0, 0, 2), 0.1), CAMERAS["orthographic"]()
    with pytest.raises(ValueError, match="camera must have a center where its rays"):
        ij.coverage(sphere, parallel)
