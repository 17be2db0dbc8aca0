from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from experiments.oracle import heightfield as oracle
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.heightfield_march import free_step
from impostor_jax.primitives.terrain import Terrain
from tests.checks import central_difference
from tests.groups import FULL

EXTENT = ((-1.0, 1.0), (-0.5, 1.0))
# Slopes of up to 87 degrees.
STEEP = np.random.default_rng(3).normal(size=(9, 7)).astype(np.float32)


def rays_of(origin, direction, dtype=None) -> Ray:
    parts = (jnp.asarray(np.asarray(v), dtype) for v in (origin, direction))
    return Ray(*(Vec3.from_array(part) for part in parts))


@jax.jit
def first_hit(field, rays):
    return field.intersect(rays).t


@jax.jit
def cast(field, rays):
    hit = field.intersect(rays)
    return hit, field.normal(rays, hit)


def visible(field, rays):
    hit = field.intersect(rays)
    return jnp.where(hit.mask, hit.t, 0)


def steep_rays(count, dtype, seed=0):
    rng = np.random.default_rng(seed)
    pair = oracle.random_rays(rng, count, EXTENT, -3.0, 3.0)
    return tuple(v.astype(dtype).astype(float) for v in pair)


def check_first(t, expected, origin, direction, height, dtype, scale):
    """Assert that t is the first crossing, to within rounding of the inputs."""
    hit = np.isfinite(expected)
    np.testing.assert_array_equal(np.isfinite(t), hit)
    slant = oracle.slant(height, origin, direction, expected)[hit]
    reach = (np.linalg.norm(origin, axis=1) + scale)[hit] + expected[hit]
    error = np.abs(t[hit] - expected[hit])
    # An eps of the lengths that meet there, seen at the angle of the surface.
    assert np.all(error * slant <= eps(dtype) * reach)
    if dtype == np.float64:
        assert np.all(error <= 1e-5 * expected[hit])
    else:
        # Of a hit right before the origin, rounding that alone takes more.
        assert np.mean(error <= 1e-5 * expected[hit]) > 0.99


@FULL
def test_no_crossing_of_a_bilinear_grid_is_missed(dtype):
    origin, direction = steep_rays(20_000, dtype)
    field = Heightfield(jnp.asarray(STEEP, dtype), jnp.asarray(EXTENT, dtype))
    t = np.asarray(first_hit(field, rays_of(origin, direction, dtype)), float)
    expected = oracle.first_in_cells(STEEP, EXTENT, origin, direction)
    assert 10_000 < np.isfinite(expected).sum() < 20_000
    height = oracle.heights(STEEP, EXTENT, "bilinear")
    check_first(t, expected, origin, direction, height, dtype, np.abs(STEEP).max())


@FULL
def test_no_crossing_of_a_bicubic_grid_is_missed(dtype):
    origin, direction = steep_rays(300, dtype)
    extent = jnp.asarray(EXTENT, dtype)
    field = Heightfield(jnp.asarray(STEEP, dtype), extent, "bicubic")
    t = np.asarray(first_hit(field, rays_of(origin, direction, dtype)), float)
    height = oracle.heights(STEEP, EXTENT, "bicubic")
    expected = oracle.first_in_samples(height, EXTENT, origin, direction, 500)
    # Folds that the samples passed over are crossings too.
    early = t < expected * (1 - 1e-4)
    assert early.sum() <= 3
    point = (origin + t[:, None] * direction)[early]
    gap = point[:, 1] - height(point[:, 0], point[:, 2])
    assert np.all(np.abs(gap) < 1e-5)
    expected = np.where(early, t, expected)
    check_first(t, expected, origin, direction, height, dtype, np.abs(STEEP).max())


TERRAIN = Terrain(octaves=5)
LAND = ((-20.0, 20.0), (-20.0, 20.0))


def land(**options):
    return Heightfield(TERRAIN, LAND, **options)


SAFE = {
    "lipschitz": {"lipschitz": TERRAIN.lipschitz},
    "curvature": {"lipschitz": TERRAIN.lipschitz, "curvature": TERRAIN.curvature},
}


@pytest.mark.parametrize("bounds", SAFE)
@pytest.mark.usefixtures("double")
def test_no_crossing_of_a_function_is_missed(bounds):
    rng = np.random.default_rng(1)
    origin, direction = oracle.random_rays(rng, 200, LAND, -10.0, 10.0)
    t = np.asarray(first_hit(land(**SAFE[bounds]), rays_of(origin, direction)))
    height = partial(oracle.terrain, octaves=5)
    expected = oracle.first_in_samples(height, LAND, origin, direction, 4000)
    # The rounding of x and z, times the bound of the slope.
    check_first(t, expected, origin, direction, height, np.float64, 400.0)


def test_terrain_is_the_published_one_and_keeps_its_bounds():
    rng = np.random.default_rng(2)
    x, z = rng.uniform(-50, 50, (2, 1000))
    terrain = Terrain()
    found = np.asarray(terrain(*(jnp.asarray(v, jnp.float32) for v in (x, z))))
    np.testing.assert_allclose(found, oracle.terrain(x, z), atol=1e-3)
    step, a = 1e-4, rng.uniform(0, 2 * np.pi, 1000)
    before, here, after = (
        oracle.terrain(x + k * step * np.cos(a), z + k * step * np.sin(a))
        for k in (-1, 0, 1)
    )
    assert np.max(np.abs(after - before)) / (2 * step) < terrain.lipschitz
    assert np.max(np.abs(after - 2 * here + before)) / step**2 < terrain.curvature


@pytest.mark.parametrize("gap", [1e-3, 0.5])
@pytest.mark.parametrize("slope", [-1.0, 0.0, 0.5])
@pytest.mark.parametrize("bend", [-2.0, 0.0, 3.0])
def test_a_free_step_ends_at_the_root_of_its_parabola(gap, slope, bend):
    step = float(free_step(*(jnp.float32(x) for x in (gap, slope, bend))))
    roots = np.roots([bend / 2, slope, gap] if bend else [slope, gap])
    ahead = [r.real for r in roots if np.isreal(r) and r.real > 0]
    assert step == pytest.approx(min(ahead, default=np.inf), rel=1e-5)


KINDS = {
    "bilinear": lambda: Heightfield(STEEP.tolist(), EXTENT),
    "function": lambda: land(**SAFE["curvature"]),
}


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.usefixtures("double")
def test_derivative_is_that_of_finite_differences(name):
    field = KINDS[name]()
    extent, low = (LAND, -8.0) if name == "function" else (EXTENT, -2.0)
    rng = np.random.default_rng(4)
    origin, direction = oracle.random_rays(rng, 300, extent, low, -low)
    pair = (field, rays_of(origin, direction))
    tangents = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=jnp.shape(x))), pair)

    @jax.jit
    def depth_slope_and_normal(pair):
        def depth(pair):
            hit = pair[0].intersect(pair[1])
            return jnp.where(hit.mask, hit.t, 0), pair[0].normal(pair[1], hit)

        return jax.jvp(depth, (pair,), (tangents,), has_aux=True)

    value, forward, normal = depth_slope_and_normal(pair)
    numeric = central_difference(
        lambda pair: depth_slope_and_normal(pair)[0], pair, tangents, 1e-7
    )
    slant = np.abs(np.asarray(normal.dot(pair[1].direction)))
    steep = (np.asarray(value) > 0) & (slant > 0.05)
    error = np.abs(numeric - forward) / (1 + np.abs(forward))
    # Where the difference spans a crest or a crease, it is none of a smooth depth.
    assert np.mean(error[steep] < 1e-4) > 0.99
    assert steep.sum() > 100


def test_height_parameters_get_gradients_in_both_modes():
    rays = rays_of([(0.3, 9.0, 0.2)], [(0.1, -1.0, 0.3)], "float32")

    def depth(amplitude):
        terrain = Terrain(amplitude=amplitude, octaves=5)
        return visible(Heightfield(terrain, LAND, lipschitz=12.0), rays)[0]

    @jax.jit
    def both_modes(amplitude):
        return jax.jacfwd(depth)(amplitude), jax.grad(depth)(amplitude)

    forward, reverse = both_modes(2.0)
    np.testing.assert_allclose(forward, reverse, rtol=1e-6)
    assert abs(float(forward)) > 0.1


def test_depth_of_a_plane_is_its_closed_form():
    # y = 0.5 x + 0.25 z + 0.1 from above, from below, past its border, from beside.
    x, z = np.meshgrid([-1, 0, 1], [-1, 1], indexing="ij")
    field = Heightfield(0.5 * x + 0.25 * z + 0.1, ((-1, 1), (-1, 1)), "bicubic")
    rays = rays_of(
        [(0.2, 3.0, 0.4), (0.2, -3.0, 0.4), (0.2, 3.0, 0.4), (-5.0, 0.1, 0.0)],
        [(0, -2, 0), (0, 1, 0), (0.5, -1, 0), (1, 0, 0)],
        "float32",
    )
    hit, normal = cast(field, rays)
    np.testing.assert_allclose(hit.t, [1.35, 3.3, np.inf, 5.0], rtol=1e-6)
    up = np.array([-0.5, 1, -0.25]) / np.sqrt(1.3125)
    np.testing.assert_allclose(normal.stack(), [up, -up, 0 * up, up], atol=1e-6)


def test_a_ray_from_the_surface_leaves_it():
    field = Heightfield(np.zeros((3, 3)), EXTENT)
    directions = [(0, 1, 0), (0, -1, 0), (1, 0.5, 0), (1, 1e-6, 0.3)]
    rays = rays_of([(0.1, 0.0, 0.2)] * 4, directions, "float32")
    assert np.isposinf(np.asarray(first_hit(field, rays))).all()


def test_a_batch_is_rendered_by_vmap():
    heights = jnp.asarray([0.0, 0.5])
    batch = Heightfield(jnp.ones((2, 3, 2)) * heights[:, None, None], EXTENT)
    assert batch.batch_shape == (2,)
    # From 3 m above, straight down.
    camera_from_world = ij.RigidTransform([[1, 0, 0], [0, 0, 1], [0, -1, 0]], (0, 0, 3))
    camera = ij.PinholeCamera(
        20, 20, 7.5, 5.5, 16, 12, camera_from_world=camera_from_world
    )
    outputs = ("depth", "normal", "mask", "range")
    maps = jax.vmap(lambda field: ij.render(field, camera, outputs))(batch)
    mask = np.asarray(maps.mask)
    assert (mask.sum(axis=(1, 2)) > 60).all()
    depth = np.where(mask, 3 - np.asarray(heights)[:, None, None], np.inf)
    np.testing.assert_allclose(maps.depth, depth, rtol=1e-6)
    v, u = np.mgrid[:12, :16]
    length = np.sqrt(1 + ((u - 7.5) / 20) ** 2 + ((v - 5.5) / 20) ** 2)
    np.testing.assert_allclose(maps.range, depth * length, rtol=1e-6)
    facing = np.where(mask[..., None], [0, 0, -1], 0)
    np.testing.assert_allclose(maps.normal, facing, atol=1e-6)
    with pytest.raises(ValueError, match="must be a single one, got a batch of shape"):
        batch.intersect(rays_of(np.zeros((2, 3)), np.ones((2, 3))))


def test_distance_is_of_first_order_and_positive_beside():
    field = Heightfield([[0.0, 0.0], [2.0, 2.0]], ((0, 1), (0, 1)))
    points = [(0.5, 2.0, 0.5), (0.5, 0.0, 0.5), (4.0, 2.0, 0.5)]
    found = field.implicit(Vec3.from_array(jnp.asarray(points)))
    np.testing.assert_allclose(found, [1 / 5**0.5, -1 / 5**0.5, 3], rtol=1e-6)


@FULL
@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((np.zeros((1, 5)), EXTENT), {}, "at least 2 samples along x and z"),
        ((np.zeros(5), EXTENT), {}, "height must be meters of shape"),
        (([[0, np.nan], [0, 0]], EXTENT), {}, "height must be finite meters"),
        ((STEEP, ((1, -1), (0, 1))), {}, "x0 < x1 and z0 < z1, got"),
        ((STEEP, (0, 1)), {}, r"extent must be meters of shape \(2, 2\)"),
        ((STEEP, EXTENT, "cubic"), {}, "one of bilinear, bicubic; got 'cubic'"),
        ((TERRAIN, LAND), {}, "lipschitz must bound the slope of height"),
        ((TERRAIN, LAND), {"lipschitz": -1}, "lipschitz must be a number"),
        ((STEEP, EXTENT), {"lipschitz": 1}, "must be None for an array of heights"),
    ],
)
def test_bad_argument_is_refused(arguments, options, message):
    with pytest.raises(ValueError, match=message):
        Heightfield(*arguments, **options)
