"""Near and far: what a camera sees of shapes that two planes cut."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.numerics import eps
from tests.cases import PRIMITIVES, TURNED, pose
from tests.checks import all_finite, central_difference, compiled_cost
from tests.groups import FULL, RELEASE

WIDTH, HEIGHT = 32, 24
CAMERA = ij.PinholeCamera(28.0, 29.0, 15.3, 11.6, WIDTH, HEIGHT)
CENTER, RADIUS = np.array([0.02, -0.01, 1.0]), 0.3
SIZE = np.array([0.4, 0.3, 0.5])
NEAR, FAR = 0.95, 1.1
MAPS = ("depth", "normal", "mask", "index")


def ball():
    return ij.Sphere(CENTER, RADIUS)


def can():
    return ij.Cylinder((0.02, -0.05, 1.0), (0.3, 0.8, 0.52), 0.2, 0.5)


def stretch_in(shape, d):
    """Where rays from 0 enter a shape and leave it, and its normal at points."""
    if isinstance(shape, ij.Sphere):
        d_d, c_d = (d * d).sum(-1), d @ CENTER
        with np.errstate(invalid="ignore"):
            half = np.sqrt(c_d**2 - d_d * (CENTER @ CENTER - RADIUS**2))
        return (c_d - half) / d_d, (c_d + half) / d_d, lambda p: p - CENTER
    o, d = -TURNED.T @ CENTER, d @ TURNED
    ends = np.sort([(-SIZE / 2 - o) / d, (SIZE / 2 - o) / d], axis=0)
    enter, leave = ends[0].max(-1), ends[1].min(-1)
    leave = np.where(enter > leave, np.nan, leave)

    def normal(p):
        own = (p - CENTER) @ TURNED / SIZE
        face = np.arange(3) == np.abs(own).argmax(-1)[:, None]
        return (np.sign(own) * face) @ TURNED.T

    return enter, leave, normal


@FULL
@pytest.mark.parametrize(
    "shape", [ball, lambda: ij.Box(CENTER, TURNED, SIZE)], ids=["ball", "box"]
)
@pytest.mark.parametrize(("near", "far"), [(NEAR, None), (None, 0.8), (NEAR, FAR)])
def test_what_is_cut_is_seen_as_geometry_has_it(shape, near, far, dtype):
    shape = shape()
    maps = ij.render(shape, CAMERA, MAPS, near=near, far=far)
    row, col = np.indices((HEIGHT, WIDTH))
    d = np.stack([(col - 15.3) / 28, (row - 11.6) / 29, np.ones(row.shape)], -1)
    enter, leave, normal = stretch_in(shape, d)
    low, high = near or 0, far or np.inf
    expected = np.where(enter > low, enter, leave)
    expected[np.isnan(leave) | (leave <= low) | (expected > high)] = np.inf
    seen = np.isfinite(expected)
    inside = seen & (expected == leave)
    assert 50 < seen.sum() < 0.8 * seen.size
    assert (inside.sum() > 30) == (near is not None)
    np.testing.assert_array_equal(maps.mask, seen)
    np.testing.assert_array_equal(maps.index, np.where(seen, 0, -1))
    np.testing.assert_allclose(maps.depth, expected, rtol=eps(dtype, 64))
    n = normal((d * np.where(seen, expected, 0)[..., None])[seen])
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    n *= np.where(inside[seen], -1, 1)[:, None]
    np.testing.assert_allclose(
        np.asarray(maps.normal)[seen], n, atol=eps(dtype, 64) / RADIUS
    )
    assert not np.asarray(maps.normal)[~seen].any()


@FULL
@pytest.mark.parametrize(
    "name",
    [
        *("torus", "bored can", "heightfield"),
        *(pytest.param(name, marks=RELEASE) for name in ("frustum", "triangle")),
    ],
)
def test_near_is_a_step_of_parallel_rays(name):
    """A camera that stands at the near plane sees the same, and has no near plane."""
    shape, step = PRIMITIVES[name](), 2.9375
    camera = ij.OrthographicCamera(24.0, 24.0, 13.0, 16.0, WIDTH, HEIGHT)
    ahead = eqx.tree_at(
        lambda c: c.camera_from_world,
        camera,
        ij.RigidTransform(np.eye(3), (0, 0, -step)),
        is_leaf=lambda x: x is None,
    )
    maps, moved = ij.render(shape, camera, near=step), ij.render(shape, ahead)
    whole = np.asarray(ij.render(shape, camera).depth)
    both = np.asarray(maps.mask & moved.mask)
    assert both.sum() > 20
    assert (np.asarray(maps.mask) != np.asarray(moved.mask)).sum() <= 1
    # Of what is cut, something else is seen than was in front of it.
    assert (whole[both] < step).any() or name == "triangle"
    depth = np.asarray(moved.depth)[both] + step
    np.testing.assert_allclose(np.asarray(maps.depth)[both], depth, atol=2e-5)
    np.testing.assert_allclose(
        np.asarray(maps.normal)[both], np.asarray(moved.normal)[both], atol=2e-3
    )


def crowd():
    """Cans, which are searched, a ball, a ground and a solid; from near to far."""
    place = jnp.array([[-0.3, 0, 0.8], [0.1, 0.1, 1.0], [0.3, -0.1, 1.3]])
    cans = ij.Cylinder(
        place, jnp.tile(jnp.array([[0.2, 1.0, 0.3]]), (3, 1)),
        jnp.full(3, 0.15), jnp.full(3, 0.6),
    )  # fmt: skip
    solid = ball() - ij.Sphere(CENTER - [0, 0, 0.2], 0.2)
    return ij.Scene([cans, solid, ij.Plane((0, 0, 1.6), (0.1, 0, -1))])


@FULL
def test_behind_what_near_cuts_the_next_of_a_scene_is_seen():
    scene = crowd()
    whole = ij.render(scene, CAMERA, MAPS)
    cut = ij.render(scene, CAMERA, MAPS, near=NEAR, far=1.5)
    # Each shape alone, the nearest of them: a scene has no other rule.
    shapes = [
        jax.tree.map(lambda x, k=k: x[k], group.primitives)
        for group in scene.groups
        for k in range(int((np.asarray(group.index) >= 0).sum()))
    ]
    index = np.concatenate([np.asarray(g.index)[g.index >= 0] for g in scene.groups])
    depth = [ij.render(s, CAMERA, near=NEAR, far=1.5).depth for s in shapes]
    order = np.argsort(index)
    depth = np.asarray(depth)[order]
    expected = np.where(np.isfinite(depth.min(0)), depth.argmin(0), -1)
    assert (np.asarray(cut.index) != expected).sum() <= 2
    np.testing.assert_allclose(cut.depth, depth.min(0), rtol=1e-5)
    assert (np.asarray(whole.depth) < NEAR).sum() > 100
    assert np.asarray(whole.index)[np.asarray(cut.index) < 0].min() >= 0
    kept = np.asarray(whole.mask) & (np.abs(np.asarray(whole.depth) - 1.2) < 0.24)
    same = np.asarray(whole.index)[kept] == np.asarray(cut.index)[kept]
    assert kept.sum() > 30
    assert same.all()


@FULL
def test_traced_depths_render_as_concrete_ones_and_a_batch_of_them():
    def depth(near, far):
        return ij.render(can(), CAMERA, ("depth",), near=near, far=far).depth

    given = jnp.array([[0.3, 1.0], [0.9, 1.05], [1.0, 5.0]])
    every = jax.jit(jax.vmap(depth))(given[:, 0], given[:, 1])
    for (near, far), found in zip(given, every, strict=True):
        one = np.asarray(depth(float(near), float(far)))
        np.testing.assert_allclose(found, one, rtol=1e-6)
    assert len({int(np.isfinite(x).sum()) for x in every}) == 3


@FULL
def test_derivatives_at_a_cut_are_those_of_the_surface_that_is_seen(double):
    solid = can() - ij.Sphere((0.0, 0.0, 0.9), 0.15)
    shapes = can(), solid

    @jax.jit
    @functools.partial(jax.value_and_grad, allow_int=True)
    def depth_sum(given):
        shapes, near = given
        total = 0.0
        for shape in shapes:
            maps = ij.render(shape, CAMERA, near=near, far=1.15)
            weight = jnp.sin(jnp.arange(maps.depth.size)).reshape(maps.depth.shape)
            total += jnp.sum(jnp.where(maps.mask, weight * maps.depth, 0))
        return total

    given = shapes, jnp.asarray(0.955)
    _, gradient = depth_sum(given)
    assert gradient[1] == 0
    assert all_finite(gradient)
    rng = np.random.default_rng(1)
    tangent = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), shapes)
    slope = sum(
        jnp.vdot(x, dx)
        for x, dx in zip(
            jax.tree.leaves(gradient[0]), jax.tree.leaves(tangent), strict=True
        )
    )
    expected = central_difference(
        lambda s: depth_sum((s, given[1]))[0], shapes, tangent, step=1e-8
    )
    np.testing.assert_allclose(slope, expected, rtol=1e-5)


@jax.jit
@functools.partial(jax.value_and_grad, allow_int=True)
def total_and_gradient(scene, near):
    maps = ij.render(scene, CAMERA, near=near, far=near + 0.2, miss=0.0)
    total = jnp.sum(maps.depth) + jnp.sum(maps.normal)
    return jnp.where(jnp.isfinite(total), total, jnp.nan)


@FULL
@pytest.mark.parametrize("near", [0.0, 0.7, 1.0, 1.2, 3.0])
def test_no_number_and_no_derivative_is_nan_wherever_the_cut_is(near):
    scene = ij.Scene([can(), ij.Cylinder((0.0, 0.0, 1.0), (0, 0, 1), 0.1, 0.4)])
    value, gradient = total_and_gradient(scene, near)
    assert np.isfinite(value)
    leaves = [x for x in jax.tree.leaves(gradient) if x.dtype != jax.dtypes.float0]
    assert leaves
    assert all_finite(leaves)


@FULL
def test_the_depth_of_a_spherical_camera_is_the_range():
    camera = ij.SphericalCamera.regular(40, 12, fov_up=0.5, fov_down=-0.5)
    room = ij.Sphere((0.3, 0.0, -0.2), 2.0)
    whole = np.asarray(ij.render(room, camera).depth)
    cut = ij.render(room, camera, ("depth", "range", "mask"), near=1.8, far=2.1)
    seen = (whole >= 1.8) & (whole <= 2.1)
    assert 50 < seen.sum() < seen.size - 50
    np.testing.assert_array_equal(cut.mask, seen)
    np.testing.assert_allclose(np.asarray(cut.depth)[seen], whole[seen], rtol=1e-6)
    # Its pictures are cut there, too.
    lights, sky = [ij.AmbientLight(1.0)], (0.25, 0.5, 0.0)
    color = ij.trace(room, camera, lights, background=sky, near=1.8, far=2.1)
    np.testing.assert_allclose(color[seen], 1)
    np.testing.assert_allclose(np.asarray(color)[~seen, 0], 0.25)


@FULL
def test_a_picture_shows_what_is_rendered():
    scene = crowd()
    colors = np.eye(5, 3) + np.arange(5)[:, None] / 8
    color = ij.trace(
        scene, CAMERA, [ij.AmbientLight(1.0)], list(map(ij.Material, colors)),
        (0.3, 0.1, 0.2), near=NEAR, far=1.5,
    )  # fmt: skip
    index = ij.render(scene, CAMERA, MAPS, near=NEAR, far=1.5).index
    expected = np.concatenate([colors, [(0.3, 0.1, 0.2)]])[np.asarray(index)]
    assert (np.abs(np.asarray(color) - expected).max(-1) > 1e-5).sum() <= 2


@FULL
def test_edges_of_a_cut_stay_hard_and_outlines_are_mixed():
    """Of a ball that is cut a ring is seen outside, and a bowl within it."""
    scene = ij.Scene([ball(), ij.Plane((0, 0, 1.6), (0, 0, -1))])
    materials = [ij.Material((1.0, 0, 0)), ij.Material((0, 1.0, 0))]

    def color(edges, near):
        lights = [ij.AmbientLight(1.0)]
        return np.asarray(
            ij.trace(scene, CAMERA, lights, materials, edges=edges, near=near)
        )

    # Cut behind its outline, in front of which nothing is left.
    np.testing.assert_array_equal(color("area", 1.1), color("hard", 1.1))
    # Cut in front of its outline, which is that of the whole ball.
    mixed, whole = color("area", 0.85), color("area", 0.0)
    np.testing.assert_allclose(mixed, whole, atol=1e-5)
    assert ((whole[..., 0] > 0) & (whole[..., 0] < 1)).sum() > 20


@FULL
def test_a_mirror_shows_what_the_camera_does_not():
    wall = ij.Plane((0, 0, 1.5), (0, 0, -1))
    ball = ij.Sphere((0, 0, 0.6), 0.15)
    red, mirror = ij.Material((1, 0, 0)), ij.Material((0, 0, 1), reflect=1.0)
    color = ij.trace(
        ij.Scene([ball, wall]), CAMERA, [ij.AmbientLight(1.0)], [red, mirror], near=1.0
    )
    alone = ij.render(ball, CAMERA).mask
    reflected = np.asarray(color)[..., 0] > 0.5
    # The ball itself is cut away; its image, 2.4 m away, is smaller than it was.
    assert 4 < reflected.sum() < np.asarray(alone).sum() / 8


@FULL
def test_silhouettes_are_cut_as_the_masks_of_each_shape_are():
    shapes = jax.tree.map(lambda *x: jnp.stack(x), can(), eqx.tree_at(
        lambda c: c.center, can(), jnp.array([0.5, 0.1, 0.9])
    ))  # fmt: skip
    margin = (HEIGHT, WIDTH)
    wide = ij.PinholeCamera(
        28.0, 29.0, 15.3 + WIDTH, 11.6 + HEIGHT, 3 * WIDTH, 3 * HEIGHT
    )
    found = ij.silhouettes(shapes, CAMERA, margin, near=NEAR, far=FAR)
    for k in range(2):
        shape = jax.tree.map(lambda x, k=k: x[k], shapes)
        mask = ij.render(shape, CAMERA, ("mask",), near=NEAR, far=FAR).mask
        np.testing.assert_array_equal(found.mask[k], mask)
        all_of_it = ij.render(shape, wide, ("mask",), near=NEAR, far=FAR).mask
        assert int(found.count[k]) == int(all_of_it.sum())
        assert 0 < mask.sum() < ij.render(shape, CAMERA, ("mask",)).mask.sum()


def test_a_sampled_coverage_is_cut_and_the_exact_one_is_refused():
    effort = ij.Effort(samples=4)
    cut = ij.render(ball(), CAMERA, ("coverage",), effort=effort, near=NEAR, far=FAR)
    mask = np.asarray(ij.render(ball(), CAMERA, ("mask",), near=NEAR, far=FAR).mask)
    covered = np.asarray(cut.coverage)
    assert abs(covered.sum() - mask.sum()) < 6
    assert ((covered > 0) & (covered < 1)).sum() > 10
    with pytest.raises(ValueError, match="what near and far cut"):
        ij.render(ball(), CAMERA, ("coverage",), near=NEAR)


@FULL
def test_a_tile_and_a_posed_camera_cut_in_the_camera_frame():
    moved = pose()
    camera = eqx.tree_at(
        lambda c: c.camera_from_world, CAMERA, moved, is_leaf=lambda x: x is None
    )
    shape = can().transformed(moved.inverse())
    expected = ij.render(can(), CAMERA, near=NEAR, far=FAR)
    maps = ij.render(shape, camera, near=NEAR, far=FAR, effort=ij.Effort(extent="tile"))
    assert (np.asarray(maps.mask) != np.asarray(expected.mask)).sum() <= 2
    both = np.asarray(maps.mask & expected.mask)
    np.testing.assert_allclose(
        np.asarray(maps.depth)[both], np.asarray(expected.depth)[both], rtol=1e-5
    )


@FULL
def test_near_and_far_cost_a_sum_and_a_comparison():
    def cost(**given):
        return compiled_cost(
            lambda shape, given: ij.render(shape, CAMERA, ("depth",), **given),
            can(), given,
        )  # fmt: skip

    bare = cost()
    assert cost(far=1.0)[0] <= 1.02 * bare[0]
    # Rays that start at 0 drop out of some sums.
    assert cost(near=0.5)[0] <= 1.2 * bare[0]


@pytest.mark.parametrize(
    ("near", "far", "what"),
    [
        (-0.1, None, "near must not be negative, since rays start at depth 0"),
        (np.nan, None, "near must be a finite number in meters"),
        ("close", None, "near must be a finite number in meters"),
        ((0.1, 0.2), None, "near must be a finite number in meters"),
        (np.inf, None, "near must be a finite number in meters"),
        (None, 0.0, "far must be a positive number in meters"),
        (None, np.nan, "far must be a positive number in meters"),
        (1.0, 1.0, "far must be more than near, 1.0 meters, got 1.0"),
    ],
)
def test_depths_out_of_range_are_refused(near, far, what):
    shapes = jax.tree.map(lambda x: x[None], can())
    for call in (
        lambda: ij.render(can(), CAMERA, near=near, far=far),
        lambda: ij.trace(can(), CAMERA, [], near=near, far=far),
        lambda: ij.silhouettes(shapes, CAMERA, near=near, far=far),
    ):
        with pytest.raises(ValueError, match=what):
            call()


def test_an_endless_far_is_none():
    whole = ij.render(can(), CAMERA, ("depth",)).depth
    far = ij.render(can(), CAMERA, ("depth",), far=np.inf).depth
    np.testing.assert_array_equal(whole, far)
