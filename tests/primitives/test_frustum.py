import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from experiments.oracle.condition import decisions, frustum_bounds
from experiments.oracle.frustum import answer, frustum_rays
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from tests.checks import AS_USERS_RUN, all_finite
from tests.groups import FULL

CAMERA = ij.PinholeCamera(60.0, 62.0, 31.5, 23.0, 64, 48)
DECISION = 8
"""Relative change of the inputs, in eps, within which a decision may be wrong."""


def scene(numbers, zero=None, caps=True, cut_faces=True):
    """Ray and frustum of 14 numbers, or 16 with a sector."""
    p1, p2, (radius1, radius2) = numbers[6:9], numbers[9:12], numbers[12:14]
    angles = (None, None, None) if zero is None else (*numbers[14:], zero)
    frustum = ij.Frustum(p1, p2, radius1, radius2, *angles, caps, cut_faces)
    return Ray(Vec3(*numbers[:3]), Vec3(*numbers[3:6])), frustum


def depth(numbers, *rest):
    ray, frustum = scene(numbers, *rest)
    return frustum.intersect(ray).t


@functools.cache
def caster(caps=True, cut_faces=True):
    """Depth, part, normal, and the derivatives of depth in all numbers."""

    def cast(numbers, zero):
        ray, frustum = scene(numbers, zero, caps, cut_faces)
        hit = frustum.intersect(ray)
        slope = jax.grad(depth)(numbers, zero, caps, cut_faces)
        return hit.t, hit.part, frustum.normal(ray, hit).stack(), slope

    return jax.jit(jax.vmap(cast), compiler_options=AS_USERS_RUN)


@jax.jit
@jax.vmap
def margins(numbers):
    o, d, p1, p2 = numbers[:12].reshape(4, 3)
    return decisions(frustum_bounds, o, d, p1, p2, numbers[12], numbers[13])


def at_tip(numbers, t):
    """Whether rounding moves the hit by a good part of the radius there."""
    x = numbers.astype(float)
    hit, way = x[:3] + float(t) * x[3:6] - x[6:9], x[9:12] - x[6:9]
    part = hit @ way / (way @ way)
    radius = (1 - part) * x[12] + part * x[13]
    reach = np.linalg.norm(float(t) * x[3:6]) + np.abs(x[6:12]).max()
    return abs(radius) < eps(numbers.dtype, 10_000) * reach


@FULL
def test_depth_keeps_its_promise_over_all_extremes(dtype):
    rays = frustum_rays(500, 3, str(dtype))
    t, part, normal, slopes = jax.tree.map(
        np.asarray, caster()(jnp.asarray(rays), None)
    )
    assert not np.isnan(t).any()
    assert all_finite((normal, slopes))
    with jax.enable_x64(True):
        sure = [np.asarray(x) for x in margins(jnp.asarray(rays, float))]
    told = 0
    for k, numbers in enumerate(rays):
        exact, (hit, surface) = answer(numbers), (sure[0][k], sure[1][k])
        if np.isfinite(t[k]) != (exact.t is not None):
            assert min(hit, surface) < eps(dtype, DECISION)
            continue
        if exact.derivative is None or at_tip(numbers, exact.t):
            continue
        if surface < eps(dtype, DECISION):
            continue
        assert part[k] == exact.part
        derivative = np.array([float(x) for x in exact.derivative])
        condition = np.sum(np.abs(numbers * derivative)) / float(exact.t)
        if eps(dtype) * condition > 0.1:
            continue
        told += 1
        assert abs(float(t[k] / exact.t) - 1) <= eps(dtype, 8) * condition
        # Where the hit is well known in units of the frustum, so is the gradient.
        cosine = -np.array(exact.normal, float) @ numbers[3:6]
        way = numbers[9:12].astype(float) - numbers[6:9]
        least = min(np.linalg.norm(way), max(numbers[12:14]))
        reach = max(*np.abs(numbers[:3]), *np.abs(numbers[6:14]))
        if reach < 100 * least and cosine > 0.05:
            lost = np.linalg.norm(slopes[k] - derivative) / np.linalg.norm(derivative)
            assert lost <= eps(dtype, 100_000)
    assert told > 200


@FULL
def test_products_are_numbers_with_lengths_from_1e_minus_12_to_1e12():
    # Single precision has the smaller range.
    dtype = np.dtype("float32")
    rays, rng = frustum_rays(5000, 4, str(dtype)), np.random.default_rng(5)
    size = np.abs(rays[:, 6:14]).max(axis=1, keepdims=True)
    scale = np.exp(rng.uniform(*np.log([1e-12, 1e12]), (len(rays), 1))) / size
    rays[:, :3] *= scale
    rays[:, 6:] *= scale
    length = np.linalg.norm(rays[:, 9:12] - rays[:, 6:9], axis=1)
    sizes = np.where(rays[:, 12:14] > 0, rays[:, 12:14], 1)
    rays = rays[(np.minimum(length, sizes.min(axis=1)) > 1e-12)]
    assert len(rays) > 2000
    numbers = jnp.asarray(rays, dtype)
    along = jnp.asarray(rng.normal(size=rays.shape), dtype)

    @jax.jit(compiler_options=AS_USERS_RUN)
    @jax.vmap
    def products(numbers, along):
        return jax.jvp(jax.grad(depth), (numbers,), (along,))

    assert all_finite(products(numbers, along))


SECTORS = {"closed": (True, True), "without faces": (True, False)}


@FULL
@pytest.mark.parametrize("kind", SECTORS)
@pytest.mark.usefixtures("double")
def test_sector_is_answered_as_the_oracle_does(kind):
    rng = np.random.default_rng(7)
    caps, cut_faces = SECTORS[kind]
    count = 250
    p1, p2 = rng.normal(size=(2, count, 3))
    radii = rng.uniform(0, 1, (count, 2)) * (rng.uniform(size=(count, 2)) < 0.8)
    radii[:, 0] += 0.1
    origin = 2 * rng.normal(size=(count, 3))
    target = p1 + rng.uniform(size=(count, 1)) * (p2 - p1)
    target += rng.normal(size=(count, 3)) * 0.3
    angles = rng.uniform(-7, 7, (count, 2))
    zero = rng.normal(size=(count, 3))
    numbers = np.hstack([origin, target - origin, p1, p2, radii, angles])
    t, part, normal, slopes = jax.tree.map(
        np.asarray,
        caster(caps, cut_faces)(jnp.asarray(numbers), jnp.asarray(zero)),
    )
    assert all_finite((normal, slopes))
    seen = set()
    for k in range(count):
        exact = answer(numbers[k], zero[k], caps, cut_faces)
        if exact.t is None:
            assert np.isinf(t[k])
            continue
        assert part[k] == exact.part
        seen.add(exact.part)
        assert t[k] == pytest.approx(float(exact.t), rel=1e-12)
        np.testing.assert_allclose(normal[k], np.array(exact.normal, float), atol=1e-9)
        expected = np.array(exact.derivative, float)
        np.testing.assert_allclose(slopes[k], expected, rtol=1e-7, atol=1e-7)
    assert seen == {0, *((1, 2) if caps else ()), *((3, 4) if cut_faces else ())}


@FULL
def test_cylinder_is_the_smooth_limit_of_equal_radii():
    # In single precision, the harder one.
    dtype = np.dtype("float32")
    can = ij.Cylinder((0.1, -0.2, 3.0), (0.3, 0.8, 0.52), 0.5, 1.4)
    half = 0.7 * can.axis
    expected = ij.render(can, CAMERA)
    for ratio in (1.0, 1 + 1e-6):
        frustum = ij.Frustum(can.center - half, can.center + half, 0.5, 0.5 * ratio)
        found = ij.render(frustum, CAMERA)
        both = expected.mask & found.mask
        assert jnp.sum(expected.mask != found.mask) <= 1
        rows, cols = np.nonzero(np.asarray(both))
        apart = np.abs(found.depth / expected.depth - 1)[rows, cols]
        ray = CAMERA.rays(jnp.asarray(rows), jnp.asarray(cols), dtype)
        ray = np.asarray(ray.direction.stack())
        slant = -np.sum(np.asarray(expected.normal)[rows, cols] * ray, axis=1)
        # Half the change of the radius, seen at the slant of the wall, and rounding.
        allowed = 0.5 * (ratio - 1) / slant / 2.5 + eps(dtype, 16) / slant
        assert (apart <= allowed).all()
        assert np.median(apart) < 1e-6

    def total(size, other):
        shape = ij.Frustum(can.center - half, can.center + half, size, other)
        maps = ij.render(shape, CAMERA, ("depth",))
        return jnp.sum(jnp.where(both, maps.depth, 0))

    def total_of_cylinder(size):
        shape = ij.Cylinder(can.center, can.axis, size, can.height)
        maps = ij.render(shape, CAMERA, ("depth",))
        return jnp.sum(jnp.where(both, maps.depth, 0))

    size = jnp.asarray(0.5, dtype)
    first, second = jax.jit(jax.grad(total, argnums=(0, 1)))(size, size * (1 + 1e-6))
    slope = jax.jit(jax.grad(total_of_cylinder))(size)
    assert float(first + second) == pytest.approx(float(slope), rel=1e-3)
    curvature = jax.jit(jax.hessian(total))(size, size)
    assert np.isfinite(curvature)


def test_cylinder_with_a_sector_is_the_frustum_of_equal_radii():
    rest = {"start_angle": 0.3, "end_angle": 4.0, "zero": (1, 0.2, 0.1)}
    can = ij.Cylinder((0.1, -0.2, 3.0), (0.3, 0.8, 0.52), 0.5, 1.4, **rest)
    half = 0.7 * can.axis
    cup = ij.Frustum(can.center - half, can.center + half, 0.5, 0.5, **rest)
    found, expected = (ij.render(shape, CAMERA) for shape in (can, cup))
    whole = ij.Cylinder(can.center, can.axis, 0.5, 1.4)
    assert int(found.mask.sum()) < int(ij.render(whole, CAMERA).mask.sum())
    np.testing.assert_array_equal(found.mask, expected.mask)
    np.testing.assert_allclose(found.depth, expected.depth, rtol=eps("float32", 64))
    np.testing.assert_allclose(found.normal, expected.normal, atol=3e-5)


@pytest.mark.parametrize(
    ("caps", "t", "normal"),
    [
        pytest.param(True, 2.0, (0, 0, -1), id="closed: the end"),
        pytest.param(False, 3.5, (-0.6, 0, -0.8), id="open: the wall's inner side"),
    ],
)
def test_open_cone_is_seen_from_inside(caps, t, normal):
    # Radius 4 at z = 2 that shrinks by 4 / 3 per length, so that it ends at z = 5.
    cone = ij.Frustum((0, 0, 2.0), (0, 0, 5.0), 4.0, 0.0, caps=caps)
    ray = Ray(*(Vec3(*jnp.asarray(v, float)) for v in ((2, 0, 0), (0, 0, 1))))
    hit = cone.intersect(ray)
    assert float(hit.t) == pytest.approx(t, rel=1e-6)
    assert bool(hit.on_cap) == caps
    n = cone.normal(ray, hit).stack()
    np.testing.assert_allclose(n, normal, atol=1e-6)


def test_sector_across_half_a_turn_is_one_piece():
    # From 135 to 225 degrees: the angle of the arc tangent jumps in its middle.
    can = ij.Cylinder((0, 0, 3), (0, 1, 0), 1, 2, 2.4, 3.9, (0, 0, 1), cut_faces=False)
    maps = ij.render(can, CAMERA)
    assert float(maps.depth[23, 31]) == pytest.approx(2.0, rel=1e-3)
    opposite = ij.Cylinder((0, 0, 3), (0, 1, 0), 1, 2, -0.7, 0.7, (0, 0, 1))
    assert float(ij.render(opposite, CAMERA).depth[23, 31]) > 3


def test_distance_of_the_closed_frustum_is_that_of_its_surface():
    frustum = ij.Frustum((0.1, 0.2, 3.0), (0.5, -0.4, 2.5), 0.5, 0.2)
    rng = np.random.default_rng(2)
    points = rng.uniform(-1, 1, (200, 3)) + np.array([0.3, -0.1, 2.75])
    found = frustum.implicit(Vec3.from_array(jnp.asarray(points)))
    p1, way = np.array([0.1, 0.2, 3.0]), np.array([0.4, -0.6, -0.5])
    length = np.linalg.norm(way)
    q = points - p1
    along = q @ way / length
    out = np.linalg.norm(q - along[:, None] * way / length, axis=1)
    # Nearest of many points of the outline in the half-plane of axis and point.
    s = np.linspace(0, 1, 4001)[:, None]
    outline = np.vstack([
        s * [0.5, 0], [0.5, 0] + s * [-0.3, length], [0, length] + s * [0.2, 0]
    ])  # fmt: skip
    gap = np.linalg.norm(np.stack([out, along], 1)[:, None] - outline[None], axis=2)
    inside = (along > 0) & (along < length) & (out < 0.5 - 0.3 * along / length)
    expected = gap.min(axis=1) * np.where(inside, -1, 1)
    np.testing.assert_allclose(found, expected, atol=2e-4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0, 0, 1), (0, 0, 1), 1.0, 1.0), "p1 and p2 must be two points"),
        (((0, 0, 1), (0, 0, 2), -1.0, 1.0), "must not be negative, in meters"),
        (((0, 0, 1), (0, 0, 2), 0.0, 0.0), "one of them positive"),
        (((0, 0, 1), (0, 0, 2), 1.0, 1.0, 0.5), "must both be given, in radians"),
        (
            ((0, 0, 1), (0, 0, 2), 1.0, 1.0, 0.0, 2 * np.pi),
            "must differ by a part of a turn",
        ),
        (
            ((0, 0, 1), (0, 0, 2), 1.0, 1.0, 0.0, 1.0, (0, 0, 3)),
            "zero must not be along the axis",
        ),
        (((0, 0, 1), (0, 0, 2), [1.0], 1.0), "must have one batch shape"),
    ],
)
def test_bad_field_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        ij.Frustum(*arguments)
