"""What is seen far from the origin of the world is what is seen near it.

At map coordinates single precision is a grid of 0.03 to 0.5 m: 148 of 2762 pixels of a
post differed, and scenes were off by meters.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.arguments import FAR, is_exact
from impostor_jax.primitives.local_world import LocalWorld, seen_near
from tests.cases import PRIMITIVES, TURNED
from tests.groups import FULL

PLACE = np.array([512345.678, 5412345.678, 250.0])
ROUNDED = 1e-5
"""By which numbers of a scene of 2 m may differ, whose shapes are rounded to 1e-7 m
otherwise: where a ray grazes a ball its normal turns by 40 times that."""


def camera_at(place):
    """A camera that looks along x + y of its world, from a place."""
    return ij.PinholeCamera(
        60.0, 60.0, 31.5, 23.5, 64, 48,
        camera_from_world=ij.RigidTransform(TURNED, -TURNED @ place),
    )  # fmt: skip


def ahead(place, x, y, z):
    """A place in front of that camera, in the world."""
    return place + TURNED.T @ np.array([x, y, z])


def shapes_at(place):
    return [
        ij.Cylinder(ahead(place, 0.1, 0, 1.2), TURNED[1], 0.12, 0.5),
        ij.Sphere(ahead(place, -0.25, 0.1, 1.4), 0.15),
    ]


NEAR, AWAY = camera_at(np.zeros(3)), camera_at(PLACE)
OUTPUTS = ("mask", "depth", "normal", "point")


def assert_same(far, near):
    """Every number alike; `inf` in the same pixels."""
    for one, other in zip(jax.tree.leaves(far), jax.tree.leaves(near), strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_allclose(one, other, rtol=ROUNDED, atol=ROUNDED)


@FULL
@pytest.mark.parametrize("precision", [None, "float64"])
def test_a_scene_is_rendered_far_as_near(precision):
    effort = ij.Effort(precision=precision)
    far, near = (
        ij.render(ij.Scene(shapes_at(place)), camera, OUTPUTS, effort=effort)
        for place, camera in ((PLACE, AWAY), (np.zeros(3), NEAR))
    )
    assert near.mask.any()
    assert_same(far, near)


@FULL
def test_a_picture_is_traced_far_as_near():
    def picture(place, camera):
        lights = [ij.AmbientLight(0.2), ij.PointLight(ahead(place, 0.8, -0.5, 0), 0.8)]
        shadowed = ij.trace(ij.Scene(shapes_at(place)), camera, lights)
        maps = ij.render(shapes_at(place)[0], camera, ("mask", "normal", "point"))
        return shadowed, ij.shade(maps, camera, lights)

    assert_same(picture(PLACE, AWAY), picture(np.zeros(3), NEAR))


@FULL
@pytest.mark.parametrize(
    "function",
    [
        ij.coverage,
        ij.outline_box,
        lambda shape, camera: ij.signed_distance(shape, camera, jnp.ones((2, 2))),
        lambda shape, camera: ij.outline(shape, camera).toward,
        lambda shape, camera: ij.outline(primitive=shape, camera=camera).points(),
    ],
)
def test_outlines_are_told_far_as_near(function):
    can, *_ = shapes_at(PLACE)
    like, *_ = shapes_at(np.zeros(3))
    assert_same(function(can, AWAY), function(like, NEAR))


@pytest.mark.parametrize("name", PRIMITIVES)
def test_every_shape_comes_near_again(name):
    shape = PRIMITIVES[name]()
    away = shape.transformed(ij.RigidTransform(np.eye(3), PLACE))
    _, back = seen_near(AWAY, away)
    assert_same(jax.tree.leaves(back), jax.tree.leaves(shape))


def test_what_is_made_far_off_keeps_its_digits():
    for shape in shapes_at(PLACE):
        assert is_exact(shape.center)
        # A solid has them in its own pose, a batch in its own fields.
        assert is_exact((shape - ij.Sphere(PLACE, 1.0)).translation)
    assert not is_exact(ij.Sphere((0, 0, 0.99 * FAR), 1.0).center)
    # What came in single precision has none to keep.
    assert not is_exact(ij.Sphere(PLACE.astype(np.float32), 1.0).center)
    assert "512345.678" in str(ij.Sphere(PLACE, 1.0))


def test_what_is_near_is_not_moved():
    camera, (can, _) = camera_at(np.array([20.0, 5.0, 1.0])), shapes_at(np.ones(3))
    assert LocalWorld.of([camera, None]) is None
    same, other = seen_near(camera, can)
    assert same is camera
    assert other is can


def test_what_no_place_is_known_of_is_left_single():
    """In a trace numbers are rounded before they can be moved; it must still run."""
    can, _ = shapes_at(PLACE)

    def depth_of(can, camera):
        return ij.render(can, camera, outputs=("depth",)).depth

    for depth in (
        jax.jit(lambda can: depth_of(can, AWAY))(can),
        jax.jit(lambda camera: depth_of(can, camera))(AWAY),
        jax.jit(depth_of)(can, AWAY),
    ):
        assert np.isfinite(np.asarray(depth)).any()


@FULL
def test_derivatives_in_sizes_are_those_near():
    def mean_depth(radius, place, camera):
        can, _ = shapes_at(place)
        can = ij.Cylinder(can.center, can.axis, radius, 0.5)
        return ij.depth_loss(ij.render(can, camera), np.ones((48, 64), np.float32))

    far, near = (
        jax.grad(mean_depth)(jnp.float32(0.12), place, camera)
        for place, camera in ((PLACE, AWAY), (np.zeros(3), NEAR))
    )
    assert near != 0
    np.testing.assert_allclose(far, near, rtol=1e-5)
