"""Solids among other shapes: in groups, in pictures by rays, in tiles."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.io.parts import members
from impostor_jax.rendering.group import lies_alone
from tests.cases import pose
from tests.groups import FULL, RELEASE

CAMERA = ij.PinholeCamera(24.0, 24.0, 11.5, 7.5, 24, 16)


def rings(centers):
    """Bored cans, which look at the camera."""
    axes = [(0.1, 0.3, 1.0)] * len(centers)
    can = ij.Cylinder(centers, axes, [0.3] * len(centers), [0.4] * len(centers))
    bore = ij.Cylinder(centers, axes, [0.15] * len(centers), [0.4] * len(centers))
    return can - bore


def ring(center):
    return jax.tree.map(lambda x: x[0], rings([center]))


def ground(at=(0.0, 0.9, 2.5)):
    """Block of uneven ground; the field's y is up."""
    field = ij.Heightfield(
        [[0.0, 0.2, -0.1], [0.3, -0.2, 0.1], [0.0, 0.1, 0.2]],
        ((-0.8, 0.8), (-0.8, 0.8)),
        world_from_field=ij.RigidTransform(np.diag([1, -1, -1]), at),
    )
    return field & ij.Box(at, np.eye(3), (1.5, 1.0, 1.5))


def mixed():
    """Solids that share a group, and a plain can."""
    away = ij.RigidTransform(pose().rotation, (0.7, -0.3, 0.2))
    return [
        rings([(-0.5, -0.3, 2.0), (0.1, 0.2, 2.2)]),
        ij.Cylinder((0.6, 0.3, 2.5), (0, 1, 0), 0.2, 0.8),
        ring((-0.2, 0.0, 2.0)).transformed(away),
    ]


def singles(shapes):
    """The members one by one, in the order of a scene's indices."""
    for shape in shapes:
        yield from members(shape, shape.batch_shape)


@eqx.filter_jit
def alone(shape, ray):
    hit = shape.intersect(ray)
    return hit, shape.normal(ray, hit).stack()


def nearest(shapes, ray):
    """First surface that rays meet: t, index, part and normal."""
    found = [alone(shape, ray) for shape in singles(shapes)]
    t = np.stack([hit.t for hit, _ in found])
    index = np.argmin(t, axis=0)

    def chosen(values):
        values = np.stack(values)
        return np.take_along_axis(
            values, index.reshape(1, *index.shape, *(1,) * (values.ndim - 3)), 0
        )[0]

    t = t.min(axis=0)
    index = np.where(np.isfinite(t), index, -1)
    part = np.where(index < 0, -1, chosen([hit.part for hit, _ in found]))
    normal = np.where(index[..., None] < 0, 0, chosen([n for _, n in found]))
    return t, index, part, normal


def test_solids_are_grouped_by_how_they_are_made():
    groups = ij.Scene([*mixed(), ground(), ground((0.2, 0.7, 3.0))]).groups
    names = [type(group.primitives).__name__ for group in groups]
    assert sorted(names) == ["Cylinder", "Solid", "Solid", "Solid"]
    together = [group.index.tolist() for group in groups]
    # As many as the next size of a bucket; what holds a ground lies alone.
    assert sorted(together) == [[0, 1, 3, -1], [2], [4], [5]]
    for group in groups:
        count = len([k for k in group.index.tolist() if k >= 0])
        assert count == 1 or not lies_alone(group.primitives)


def test_members_of_a_batch_with_a_ground_lie_alone():
    balls = ij.Sphere([(0.0, 0.6, 2.5), (0.2, 0.6, 2.5)], [0.3, 0.2])
    both = balls - ground()
    (first, second) = ij.Scene([both]).groups
    assert (first.index.tolist(), second.index.tolist()) == ([0], [1])
    assert second.primitives.shapes[0].radius.shape == (1,)


@RELEASE
@pytest.mark.parametrize("more", [[], [ground()]], ids=len)
def test_solids_in_a_scene_are_seen_as_alone(more):
    shapes = [*mixed(), *more]
    scene = ij.Scene(shapes)
    ray = CAMERA.rays(*CAMERA.frame.pixels(), scene.dtype)
    t, index, part, normal = nearest(shapes, ray)
    assert set(np.unique(index)) == set(range(-1, 4 + len(more)))
    # Both walls of a ring, and a cap.
    assert len(np.unique(part[index == 1])) > 2
    maps = ij.render(scene, CAMERA, ("depth", "normal", "index", "part"))
    np.testing.assert_array_equal(maps.index, index)
    np.testing.assert_array_equal(maps.part, part)
    np.testing.assert_allclose(maps.depth, t, rtol=1e-5)
    np.testing.assert_allclose(maps.normal, normal, atol=1e-4)
    # Rays of any kind, which are searched in another way.
    hit = scene.intersect(ray)
    np.testing.assert_array_equal(hit.index, index)
    np.testing.assert_array_equal(np.where(hit.mask, hit.part, -1), part)
    np.testing.assert_allclose(hit.t, t, rtol=1e-5)
    np.testing.assert_allclose(scene.normal(ray, hit).stack(), normal, atol=1e-4)
    far = jnp.where(hit.mask, hit.t, 9)
    assert not np.any(scene.occluded(ray, 0.999 * far))
    np.testing.assert_array_equal(scene.occluded(ray, 1.001 * far), hit.mask)


@RELEASE
def test_a_derivative_of_a_scene_is_that_of_the_solid_that_is_seen():
    ray = Ray(Vec3(*jnp.zeros((3, 1))), Vec3.from_array(jnp.array([[-0.36, -0.15, 1]])))

    def depth(shapes):
        return ij.Scene(shapes).intersect(ray).t[0]

    shapes = [rings([(-0.5, -0.3, 2.0), (0.1, 0.2, 2.2)]), ring((0.4, 0.0, 2.0))]
    gradient = jax.grad(depth)(shapes)
    own = jax.grad(lambda one: alone(one, ray)[0].t[0])(ring((-0.5, -0.3, 2.0)))
    assert np.abs(own.shapes[0].center).max() > 0.1
    first = jax.tree.map(lambda x: x[0], gradient[0])
    for x, y in zip(jax.tree.leaves(first), jax.tree.leaves(own), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-4, atol=1e-5)
    rest = [jax.tree.map(lambda x: x[1], gradient[0]), gradient[1]]
    assert not any(np.any(x) for x in jax.tree.leaves(rest))


WALL = ij.Plane((0, 0, 3), (0, 0, -1))
LIGHTS = [ij.AmbientLight(0.2), ij.PointLight((1.0, -1.0, 0.0), 0.8)]
LOOK = [
    ij.Material((0.9, 0.6, 0.3), transmit=0.8, ior=1.4, fresnel=True),
    ij.Material((0.3, 0.6, 0.9), reflect=0.3),
]


# TODO: rays that wait in glass are promoted in rank and type, which tests forbid.
def traced(*arguments, **options):
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        return np.asarray(ij.trace(*arguments, **options))


@RELEASE
def test_a_solid_of_one_shape_is_traced_as_that():
    # Shadows, a mirror, and glass, which asks on which side of the surface a ray is.
    box = ij.Box((0, 0, 2), np.asarray(pose().rotation), (0.6, 0.5, 0.4))
    of_box, of_solid = (
        traced(ij.Scene([shape, WALL]), CAMERA, LIGHTS, LOOK)
        for shape in (box, ij.union(box).transformed(pose().inverse() @ pose()))
    )
    np.testing.assert_allclose(of_solid, of_box, atol=2e-4)
    plain = traced(ij.Scene([WALL]), CAMERA, LIGHTS, LOOK[1:])
    assert np.mean(np.abs(of_solid - plain).max(axis=-1) > 0.05) > 0.05


@RELEASE
def test_glass_with_a_hole_that_bends_nothing_is_not_seen():
    # A ray that lost count of the surfaces, or met one twice, would show its color.
    clear = ij.Material((1, 0, 0), transmit=1.0, ior=1.0)
    dull = ij.Material((0.25, 0.5, 1.0))
    turned = ring((0, 0, 2)).transformed(
        ij.RigidTransform(pose().rotation, (0.9, 0.1, 0.3))
    )
    scene = ij.Scene([turned, WALL])
    picture = traced(scene, CAMERA, [ij.AmbientLight(1.0)], [clear, dull], depth=6)
    index = ij.render(scene, CAMERA, ("index",)).index
    assert np.sum(index == 0) > 30
    expected = np.broadcast_to((0.25, 0.5, 1.0), picture.shape)
    np.testing.assert_allclose(picture, expected, atol=1e-6)


@FULL
def test_a_projector_lights_through_the_hole_of_a_solid():
    can = ij.Cylinder((0, 0, 2), (0, 0, 1), 0.5, 0.2)
    bored = can - ij.Cylinder((0, 0, 2), (0, 0, 1), 0.3, 0.2)
    for shape in (can, bored):
        scene = ij.Scene([shape, WALL])
        depth = ij.render(scene, CAMERA, ("depth",)).depth
        found = np.asarray(ij.lit(scene, CAMERA, depth, (0.3, 0, 0)))
        ray = CAMERA.rays(*CAMERA.frame.pixels(), scene.dtype)
        point = np.asarray(ray.at(depth).stack())
        start = np.array([0.3, 0, 0])
        # Where the way to the wall crosses the two ends of the can, in steps.
        t = np.linspace(1.9 / 3, 2.1 / 3, 50)[:, None, None, None]
        way = start + t * (point - start)
        off = np.hypot(way[..., 0], way[..., 1])
        hole = 0.0 if shape is can else 0.3
        hidden = np.any((off < 0.5) & (off > hole), axis=0)
        on_wall = depth > 2.95
        assert np.mean(found[on_wall] == ~hidden[on_wall]) > 0.99
        assert found[7, 11] == (shape is bored or depth[7, 11] < 2.95)


@RELEASE
def test_tiles_and_silhouettes_of_solids():
    two = rings([(-0.5, -0.1, 2.0), (0.3, 0.2, 2.2)])
    found = ij.silhouettes(two, CAMERA)
    one = jax.tree.map(lambda x: x[0], two)
    maps = ij.render(one, CAMERA, ("depth", "mask"))
    np.testing.assert_array_equal(found.mask[0], maps.mask)
    assert found.count[0] == np.sum(maps.mask)
    tile = ij.outline_tile(one, CAMERA, margin=1)
    assert tile.height * tile.width <= 16 * 16
    inside = np.zeros((16, 24), bool)
    inside[tile.row : tile.row + tile.height, tile.col : tile.col + tile.width] = True
    assert not np.any(np.asarray(maps.mask) & ~inside)
    tiled = ij.render(one, CAMERA, ("depth", "mask"), effort=ij.Effort(extent="tile"))
    np.testing.assert_allclose(tiled.depth, maps.depth, rtol=1e-6)


def test_what_solids_cannot_have_is_named():
    one = ring((0, 0, 2))
    with pytest.raises(ValueError, match="Solid"):
        ij.coverage(one, CAMERA)
    with pytest.raises(ValueError, match="Solid"):
        ij.render(one, CAMERA, ("coverage",))
