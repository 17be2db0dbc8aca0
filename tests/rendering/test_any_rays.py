"""Rays that are no camera's at scenes, beside every shape for itself."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from experiments.oracle import whitted
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.rendering import search
from impostor_jax.rendering.hierarchy import hierarchy_of
from tests.groups import RELEASE
from tests.rendering.test_scene import shapes_of, wall

TYPES = ("sphere", "cylinder", "box", "frustum", "torus", "triangle")


def ray_of(origin, direction):
    return Ray(*(Vec3.from_array(jnp.asarray(x, float)) for x in (origin, direction)))


def any_rays(shape=(400,), seed=0):
    """Of any length; some across axes, along one, and from inside of shapes."""
    rng = np.random.default_rng(seed)
    origin = rng.uniform((-2, -2, 0), (2, 2, 6), (*shape, 3))
    way = rng.normal(size=(*shape, 3)) * 10 ** rng.uniform(-3, 3, (*shape, 1))
    flat = way.reshape(-1, 3)
    flat[::5, 0] = 0
    flat[::10, 1] = -0.0
    return ray_of(origin, way)


@functools.cache
def cast():
    return jax.jit(jax.vmap(lambda shape, ray: shape.intersect(ray).t, (0, None)))


def alone(shapes, ray):
    """Ray parameters of each shape by itself, (shapes, rays)."""
    found = [None] * len(shapes)
    for kind in {type(shape) for shape in shapes}:
        numbers = [k for k, shape in enumerate(shapes) if type(shape) is kind]
        batch = jax.tree.map(lambda *x: jnp.stack(x), *(shapes[k] for k in numbers))
        for k, t in zip(numbers, np.asarray(cast()(batch, ray)), strict=True):
            found[k] = t
    return np.stack(found)


@pytest.mark.parametrize(
    ("many", "types", "dtype"),
    [
        pytest.param(128, TYPES, "float64", id="one by one"),
        # Whose boxes are the same: of all types for release.
        pytest.param(1, TYPES[::2], "float32", id="in boxes"),
        pytest.param(128, TYPES, "float32", id="one by one, single", marks=RELEASE),
        pytest.param(1, TYPES, "float32", id="in boxes, all", marks=RELEASE),
        pytest.param(1, TYPES, "float64", id="in boxes, double", marks=RELEASE),
    ],
    indirect=["dtype"],
)
def test_first_surface_is_that_of_the_nearest_shape(many, types, dtype, monkeypatch):
    monkeypatch.setattr(search, "MANY", many)
    shapes = [*shapes_of(count=30, types=types), wall()]
    scene, ray = ij.Scene(shapes), any_rays()
    each = alone(shapes, ray)
    hit = scene.intersect(ray)
    first = each.min(axis=0)
    assert 0.2 < np.isfinite(first).mean() < 0.95
    np.testing.assert_allclose(hit.t, first, rtol=eps(dtype, 64))
    np.testing.assert_array_equal(hit.mask, np.isfinite(first))
    # Another shape only where both are as near.
    seen = np.where(np.isfinite(first), np.asarray(hit.index), 0)
    own = np.take_along_axis(each, seen[None], 0)[0]
    np.testing.assert_allclose(own, first, rtol=eps(dtype, 64))
    np.testing.assert_array_equal(np.asarray(hit.index)[~np.isfinite(first)], -1)
    reach = np.random.default_rng(1).uniform(0, 2, first.shape) * np.where(
        np.isfinite(first), first, 1
    )
    reach = jnp.asarray(reach, dtype)
    np.testing.assert_array_equal(scene.occluded(ray, reach), first < reach)
    np.testing.assert_array_equal(scene.occluded(ray), np.isfinite(first))


def test_textbook_formulas_find_the_same(double):
    types = ("sphere", "cylinder", "box")
    shapes = [*shapes_of(count=20, types=types), wall()]
    ray = any_rays()
    hit = ij.Scene(shapes).intersect(ray)
    o, d = (np.asarray(v.stack()) for v in (ray.origin, ray.direction))
    length = np.linalg.norm(d, axis=1)
    t, index, outward, _ = whitted.first_hit(shapes, o, d / length[:, None])
    np.testing.assert_allclose(hit.t * length, t, rtol=1e-9)
    np.testing.assert_array_equal(hit.index, index)
    normal = np.asarray(ij.Scene(shapes).normal(ray, hit).stack())
    facing = outward * -np.sign(np.sum(outward * d, axis=1, keepdims=True))
    np.testing.assert_allclose(normal, facing, atol=1e-9)


@pytest.mark.parametrize(
    "shape", [(), (0,), pytest.param((1,), marks=RELEASE), (3, 4, 5)]
)
def test_rays_have_any_shape(shape):
    scene, ray = ij.Scene(shapes_of()), any_rays(shape)
    hit = scene.intersect(ray)
    normal, dark = scene.normal(ray, hit), scene.occluded(ray)
    assert hit.t.shape == hit.index.shape == normal.x.shape == dark.shape == shape
    flat = jax.tree.map(jnp.ravel, ray)
    np.testing.assert_array_equal(np.ravel(hit.t), scene.intersect(flat).t)


@pytest.mark.parametrize("many", [128, 1], ids=["one by one", "in boxes"])
def test_what_is_not_finite_meets_nothing(many, monkeypatch):
    monkeypatch.setattr(search, "MANY", many)
    scene = ij.Scene([*shapes_of(), wall()])
    numbers = np.tile([0.0, 0, 0, 0, 0, 1], (3, 1))
    numbers[0, 4], numbers[1, 0], numbers[2, 5] = np.nan, np.inf, -np.inf
    ray = ray_of(numbers[:, :3], numbers[:, 3:])
    hit = scene.intersect(ray)
    assert not hit.mask.any()
    assert np.isinf(hit.t).all()
    assert not scene.occluded(ray).any()
    assert not np.asarray(scene.normal(ray, hit).stack()).any()


@pytest.mark.parametrize("many", [128, 1], ids=["one by one", "in boxes"])
def test_what_fills_a_bucket_is_not_hit(many, monkeypatch):
    monkeypatch.setattr(search, "MANY", many)
    balls = [ij.Sphere((0.0, 0.0, 3.0 + k), 0.4) for k in range(5)]
    scene = ij.Scene(balls)
    (group,) = scene.groups
    assert group.index.shape == (16,)
    # Fillers are copies of the first: put them where nothing is.
    place = jnp.where(group.index >= 0, 0.0, 9.0).astype(group.primitives.center.dtype)
    center = group.primitives.center.at[:, 0].add(place)
    moved = ij.Sphere(center, group.primitives.radius)
    object.__setattr__(group, "primitives", moved)
    rays = ray_of([(9.0, 0, 0), (0.0, 0, 0)], [(0.0, 0, 1), (0.0, 0, 1)])
    np.testing.assert_array_equal(scene.intersect(rays).index, [-1, 0])
    np.testing.assert_array_equal(scene.occluded(rays), [False, True])


def test_index_counts_as_shapes_were_given():
    # Spheres and cylinders in turns, so that groups have another order.
    shapes = shapes_of()
    for k, shape in enumerate(shapes):
        ray = ray_of(shape.center, (0.0, 0.0, 1.0))
        alone_first = alone(shapes, jax.tree.map(lambda x: x[None], ray))[:, 0]
        assert int(ij.Scene(shapes).intersect(ray).index) == int(alone_first.argmin())
        assert k < len(shapes)


def test_ray_from_inside_meets_where_it_leaves(dtype):
    ball = ij.Sphere((0.0, 0.0, 3.0), 1.0)
    ray = ray_of((0.0, 0.0, 3.0), (0.0, 0.0, 2.0))
    scene = ij.Scene([ball, ij.Sphere((0.0, 0.0, 9.0), 1.0)])
    hit = scene.intersect(ray)
    assert float(hit.t) == pytest.approx(0.5, rel=eps(dtype, 8))
    assert float(scene.normal(ray, hit).z) == pytest.approx(-1, rel=eps(dtype, 8))


@pytest.mark.parametrize("many", [128, 1], ids=["one by one", "in boxes"])
def test_derivative_of_t_is_that_of_the_shape_alone(many, double, monkeypatch):
    monkeypatch.setattr(search, "MANY", many)
    shapes = shapes_of(count=4, types=TYPES[:1])
    ray = any_rays()
    seen = np.asarray(ij.Scene(shapes).intersect(ray).index)

    def total(shapes, ray, whole):
        if whole:
            t = ij.Scene(shapes).intersect(ray).t
        else:
            each = jnp.stack([shape.intersect(ray).t for shape in shapes])
            t = jnp.take_along_axis(each, jnp.maximum(seen, 0)[None], 0)[0]
        return jnp.sum(jnp.where(seen >= 0, jnp.minimum(t, 1e6), 0))

    found, expected = (
        jax.grad(functools.partial(total, whole=whole), (0, 1))(shapes, ray)
        for whole in (True, False)
    )
    for one, other in zip(*map(jax.tree.leaves, (found, expected)), strict=True):
        assert np.isfinite(one).all()
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def test_boxes_nest_and_hold_their_shapes():
    rng = np.random.default_rng(0)
    center = rng.normal(size=(64, 3))
    balls = ij.Sphere(center, rng.uniform(0.01, 0.3, 64))
    there = np.arange(64) < 50
    corners = balls.hull.box()
    tree = jax.tree.map(np.asarray, hierarchy_of(*corners, jnp.asarray(there)))
    low, high = map(np.asarray, corners)
    leaf = tree.member >= 0
    assert sorted(tree.member[leaf]) == list(range(64))
    # Each node's subtree are the nodes up to the one to go on with.
    for node, end in enumerate(tree.skip):
        inside = leaf[node:end].nonzero()[0] + node
        members = tree.member[inside]
        members = members[there[members]]
        if len(members):
            assert (tree.low[node] == low[members].min(axis=0)).all()
            assert (tree.high[node] == high[members].max(axis=0)).all()
        else:
            assert (tree.low[node] > 1e37).all()


# Half a minute, nearly all for every ball and every ray in numpy.
@RELEASE
def test_boxes_lose_no_ray():
    rng = np.random.default_rng(0)
    count, rays = 10_000, 20_000
    center = rng.uniform(-1, 1, (count, 3))
    radius = rng.uniform(0.002, 0.02, count)
    ray = ray_of(rng.uniform(-1, 1, (rays, 3)), rng.normal(size=(rays, 3)))
    balls = ij.Sphere(center, radius)
    hit = ij.Scene([balls]).intersect(ray)
    center, radius = (np.asarray(x, float) for x in (balls.center, balls.radius))
    o, d = (np.asarray(v.stack(), float) for v in (ray.origin, ray.direction))
    first, margin = np.full(rays, np.inf), np.full(rays, np.inf)
    a = np.sum(d * d, axis=1)
    for c, r in zip(center, radius, strict=True):
        w = o - c
        b, square = np.einsum("nk,nk->n", w, d), np.einsum("nk,nk->n", w, w)
        gap = r * r - (square - b * b / a)
        margin = np.minimum(margin, np.abs(gap) / r**2)
        root = np.sqrt(np.maximum(gap, 0) * a)
        t = np.where(-b - root > 0, -b - root, -b + root) / a
        first = np.where((gap > 0) & (t > 0) & (t < first), t, first)
    # Where rounding decides neither hit nor miss.
    clear = margin > 1e-4
    assert clear.mean() > 0.9
    np.testing.assert_array_equal(hit.mask[clear], np.isfinite(first)[clear])
    np.testing.assert_allclose(hit.t[clear], first[clear], rtol=1e-4)
