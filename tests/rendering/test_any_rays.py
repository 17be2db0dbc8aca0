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
from tests.groups import FULL, RELEASE
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


@functools.partial(jax.jit, static_argnames="many")
def seen(scene, ray, reach=np.inf, many=128):
    """Hits, and what is occluded; more than so many of a type are in boxes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "MANY", many)
        return scene.intersect(ray), scene.occluded(ray, reach)


@jax.jit
def normal_at(scene, ray, hit):
    return scene.normal(ray, hit).stack()


def mix(types):
    return [*shapes_of(count=30, types=types), wall()]


def alone(shapes, ray):
    """Ray parameters of each shape by itself, (shapes, rays)."""
    found = [None] * len(shapes)
    for kind in {type(shape) for shape in shapes}:
        numbers = [k for k, shape in enumerate(shapes) if type(shape) is kind]
        batch = jax.tree.map(lambda *x: jnp.stack(x), *(shapes[k] for k in numbers))
        for k, t in zip(numbers, np.asarray(cast()(batch, ray)), strict=True):
            found[k] = t
    return np.stack(found)


WAYS = pytest.mark.parametrize(
    ("many", "types", "dtype"),
    [
        # No type has a search of its own: all of them in both, for release.
        pytest.param(128, TYPES[1::2], "float64", id="one by one"),
        pytest.param(1, TYPES[::2], "float32", id="in boxes"),
        pytest.param(128, TYPES, "float64", id="one by one, all", marks=RELEASE),
        pytest.param(128, TYPES, "float32", id="one by one, single", marks=RELEASE),
        pytest.param(1, TYPES, "float32", id="in boxes, all", marks=RELEASE),
        pytest.param(1, TYPES, "float64", id="in boxes, double", marks=RELEASE),
    ],
    indirect=["dtype"],
)


@FULL
@WAYS
def test_first_surface_is_that_of_the_nearest_shape(many, types, dtype):
    shapes, ray = mix(types), any_rays()
    scene, each = ij.Scene(shapes), alone(shapes, ray)
    first = each.min(axis=0)
    reach = np.random.default_rng(1).uniform(0, 2, first.shape) * np.where(
        np.isfinite(first), first, 1
    )
    reach = reach.astype(dtype)
    hit, occluded = seen(scene, ray, reach, many)
    assert 0.2 < np.isfinite(first).mean() < 0.95
    np.testing.assert_allclose(hit.t, first, rtol=eps(dtype, 64))
    np.testing.assert_array_equal(hit.mask, np.isfinite(first))
    # Another shape only where both are as near.
    index = np.where(np.isfinite(first), np.asarray(hit.index), 0)
    own = np.take_along_axis(each, index[None], 0)[0]
    np.testing.assert_allclose(own, first, rtol=eps(dtype, 64))
    np.testing.assert_array_equal(np.asarray(hit.index)[~np.isfinite(first)], -1)
    np.testing.assert_array_equal(occluded, first < reach)
    _, anywhere = seen(scene, ray, np.full_like(reach, np.inf), many)
    np.testing.assert_array_equal(anywhere, np.isfinite(first))


@FULL
@WAYS
def test_what_is_not_finite_meets_nothing(many, types, dtype):
    origin, way = np.zeros((2, 400, 3))
    way[:, 2] = 1
    origin[1, 0], origin[2, 1], way[0, 1], way[3, 2] = np.inf, np.nan, np.nan, -np.inf
    reach = np.full(400, np.inf, dtype)
    hit, occluded = seen(ij.Scene(mix(types)), ray_of(origin, way), reach, many)
    is_finite = np.arange(400) >= 4
    np.testing.assert_array_equal(hit.mask, is_finite)
    np.testing.assert_array_equal(np.isfinite(hit.t), is_finite)
    np.testing.assert_array_equal(occluded, is_finite)


@FULL
def test_textbook_formulas_find_the_same(double):
    types = ("sphere", "cylinder", "box")
    shapes = [*shapes_of(count=20, types=types), wall()]
    ray = any_rays()
    scene = ij.Scene(shapes)
    hit, _ = seen(scene, ray)
    o, d = (np.asarray(v.stack()) for v in (ray.origin, ray.direction))
    length = np.linalg.norm(d, axis=1)
    t, index, outward, _ = whitted.first_hit(shapes, o, d / length[:, None])
    np.testing.assert_allclose(hit.t * length, t, rtol=1e-9)
    np.testing.assert_array_equal(hit.index, index)
    facing = outward * -np.sign(np.sum(outward * d, axis=1, keepdims=True))
    np.testing.assert_allclose(normal_at(scene, ray, hit), facing, atol=1e-9)


@FULL
@pytest.mark.parametrize(
    "shape", [(), (0,), pytest.param((1,), marks=RELEASE), (3, 4, 5)]
)
def test_rays_have_any_shape(shape):
    # Called as it is, step by step.
    scene, ray = ij.Scene(shapes_of(types=("sphere",))), any_rays(shape)
    hit = scene.intersect(ray)
    normal, dark = scene.normal(ray, hit), scene.occluded(ray)
    assert hit.t.shape == hit.index.shape == normal.x.shape == dark.shape == shape
    flat = jax.tree.map(jnp.ravel, ray)
    np.testing.assert_array_equal(np.ravel(hit.t), scene.intersect(flat).t)


@FULL
@pytest.mark.parametrize("many", [128, 1], ids=["one by one", "in boxes"])
def test_what_fills_a_bucket_is_not_hit(many):
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
    hit, occluded = seen(scene, rays, many=many)
    np.testing.assert_array_equal(hit.index, [-1, 0])
    np.testing.assert_array_equal(occluded, [False, True])


def test_normal_is_zero_where_nothing_is_met():
    scene = ij.Scene([ij.Sphere((0.0, 0.0, 3.0 + k), 0.4) for k in range(5)])
    rays = ray_of([(9.0, 0, 0), (np.nan, 0, 0)], [(0.0, 0, 1), (0.0, 0, 1)])
    hit, _ = seen(scene, rays)
    np.testing.assert_array_equal(normal_at(scene, rays, hit), 0)


@FULL
def test_index_counts_as_shapes_were_given():
    # Spheres and cylinders in turns, so that groups have another order.
    shapes = shapes_of()
    centers = np.stack([shape.center for shape in shapes])
    ray = ray_of(centers, np.broadcast_to([0.0, 0, 1], centers.shape))
    hit, _ = seen(ij.Scene(shapes), ray)
    np.testing.assert_array_equal(hit.index, alone(shapes, ray).argmin(axis=0))
    assert len(set(np.asarray(hit.index) % 2)) == 2


def test_ray_from_inside_meets_where_it_leaves(dtype):
    ball = ij.Sphere((0.0, 0.0, 3.0), 1.0)
    ray = ray_of((0.0, 0.0, 3.0), (0.0, 0.0, 2.0))
    scene = ij.Scene([ball, ij.Sphere((0.0, 0.0, 9.0), 1.0)])
    hit, _ = seen(scene, ray)
    assert float(hit.t) == pytest.approx(0.5, rel=eps(dtype, 8))
    assert float(normal_at(scene, ray, hit)[2]) == pytest.approx(-1, rel=eps(dtype, 8))


@FULL
@pytest.mark.parametrize("many", [128, 1], ids=["one by one", "in boxes"])
def test_derivative_of_t_is_that_of_the_shape_alone(many, double, monkeypatch):
    monkeypatch.setattr(search, "MANY", many)
    shapes = shapes_of(count=4, types=TYPES[:1])
    ray = any_rays()
    index = np.asarray(seen(ij.Scene(shapes), ray, many=many)[0].index)

    def total(shapes, ray, whole):
        if whole:
            t = ij.Scene(shapes).intersect(ray).t
        else:
            each = jnp.stack([shape.intersect(ray).t for shape in shapes])
            t = jnp.take_along_axis(each, jnp.maximum(index, 0)[None], 0)[0]
        return jnp.sum(jnp.where(index >= 0, jnp.minimum(t, 1e6), 0))

    found, expected = (
        jax.jit(jax.grad(functools.partial(total, whole=whole), (0, 1)))(shapes, ray)
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
    tree = jax.jit(hierarchy_of)(*corners, jnp.asarray(there))
    tree = jax.tree.map(np.asarray, tree)
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
