"""What is not asked for costs nothing, by the work of compiled renders.

XLA counts the operations and bytes of a program; a request is compared with its
neighbor, or with what the same result takes when written out.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.sensor.draws import normal_draws
from tests.checks import compiled_cost
from tests.groups import FULL

WIDTH, HEIGHT = 96, 64
LITTLE = 1.02
"""Room for what is computed once and not for each pixel."""


def pinhole(**more):
    return ij.PinholeCamera(80.0, 80.0, 47.5, 31.5, WIDTH, HEIGHT, **more)


def can(**more):
    return ij.Cylinder((0.02, -0.05, 1.0), (0.3, 0.8, 0.52), 0.2, 0.5, **more)


def ball():
    return ij.Sphere((0.02, -0.05, 1.0), 0.2)


def render_cost(outputs=("depth",), shape=None, camera=None, tile=None):
    return compiled_cost(
        lambda shape, camera: ij.render(shape, camera, outputs, tile),
        can() if shape is None else shape,
        pinhole() if camera is None else camera,
    )


@functools.cache
def plain_cost(outputs=("depth",)):
    """Of a can and a pinhole, beside which most are compared."""
    return render_cost(outputs)


@FULL
def test_depth_alone_is_one_cast_of_rays_of_a_pinhole():
    def written_out(shape, fx, fy, cx, cy):
        row, col = (
            jax.lax.broadcasted_iota(jnp.float32, (HEIGHT, WIDTH), axis)
            for axis in (0, 1)
        )
        x, y = (col - cx) * (1 / fx), (row - cy) * (1 / fy)
        zero = jnp.zeros_like(x)
        ray = Ray(Vec3(zero, zero, zero), Vec3(x, y, jnp.ones_like(x)))
        return shape.intersect(ray).t

    bare = compiled_cost(written_out, can(), 80.0, 80.0, 47.5, 31.5)
    assert (plain_cost() <= LITTLE * bare).all()


@FULL
@pytest.mark.parametrize("more", ["range", "point", "normal", "mask", "index"])
def test_each_output_is_paid_by_those_who_ask(more):
    without, with_it = plain_cost(), plain_cost(("depth", more))
    assert (without <= with_it).all()
    assert without[1] < with_it[1]
    alone = render_cost((more,))
    assert (alone <= LITTLE * with_it).all()


def test_a_tile_costs_its_share_of_the_image():
    whole, part = plain_cost(), render_cost(tile=ij.Tile(8, 16, HEIGHT // 4, WIDTH))
    np.testing.assert_allclose(part[0] / whole[0], 1 / 4, rtol=0.05)
    assert part[1] < 0.3 * whole[1]


@FULL
@pytest.mark.parametrize(
    "more",
    [
        pinhole(distortion=(0.1, 0, 0, 0, 0)),
        pinhole(camera_from_world=ij.RigidTransform(np.eye(3), (0, 0, 0))),
    ],
    ids=["lens", "pose"],
)
def test_a_camera_without_a_part_does_not_compute_it(more):
    assert (plain_cost() < render_cost(camera=more)).all()


def test_a_lens_that_bends_nothing_costs_nothing():
    straight = pinhole(distortion=np.zeros(5))
    np.testing.assert_array_equal(render_cost(camera=straight), plain_cost())


@FULL
@pytest.mark.parametrize(
    ("plain", "more"),
    [
        (can(), can(start_angle=0.1, end_angle=3.0)),
        (ij.Scene([can()]), ij.Scene([can(), ij.Sphere((0, 0, 2), 0.1)])),
        (ij.Scene([can()]), ij.Scene([can(), ij.Plane((0, 0, 2), (0, 0, -1))])),
        (ball(), ball() - ball()),
        (ball() - ball(), ball() - can()),
    ],
    ids=["sector", "type of shape", "plane", "solid", "shape of a solid"],
)
def test_a_shape_without_a_part_does_not_compute_it(plain, more):
    outputs = ("depth", "normal")
    without, with_it = (render_cost(outputs, shape) for shape in (plain, more))
    assert without[0] < with_it[0]


@FULL
def test_a_scene_of_one_shape_costs_as_much_as_the_shape():
    outputs = ("depth", "normal", "mask")
    alone, scene = plain_cost(outputs), render_cost(outputs, ij.Scene([can()]))
    # It is compared with the nothing that is behind it, and counted.
    assert scene[0] <= alone[0] + 10 * HEIGHT * WIDTH


@FULL
def test_silhouettes_count_a_margin_only_if_there_is_one():
    shapes = jax.tree.map(lambda x: jnp.stack([x, x]), ball())
    without, with_it = (
        compiled_cost(lambda s, m=m: ij.silhouettes(s, pinhole(), margin=m), shapes)
        for m in ((0, 0), (4, 4))
    )
    assert without[0] < with_it[0]


@FULL
@pytest.mark.parametrize(
    ("plain", "more"),
    [
        (ij.ConstantNoise(0.001), ij.StructuredLight()),
        (ij.ConstantNoise(0.001), ij.Dropout(ij.ConstantNoise(0.001))),
        (ij.ConstantNoise(0.001), ij.FlyingPixels(ij.ConstantNoise(0.001))),
    ],
    ids=["incidence", "dropout", "flying pixels"],
)
def test_a_sensor_pays_for_its_own_parts(plain, more):
    depth, normal = jnp.ones((HEIGHT, WIDTH)), jnp.zeros((HEIGHT, WIDTH, 3))

    def sample(sensor, key, depth, normal):
        return sensor.sample(key, depth, normal, pinhole())

    key = jax.random.key(0)
    without, with_it = (
        compiled_cost(sample, sensor, key, depth, normal) for sensor in (plain, more)
    )
    assert (without < with_it).all()


@FULL
def test_a_constant_sigma_needs_no_incidence():
    depth, normal = jnp.ones((HEIGHT, WIDTH)), jnp.zeros((HEIGHT, WIDTH, 3))

    def written_out(key, depth, sigma):
        reading = depth + sigma * normal_draws(key, depth.shape, depth.dtype)
        return jnp.where(reading > 0, reading, 0)

    key = jax.random.key(0)
    sensor = ij.ConstantNoise(0.001)
    found = compiled_cost(
        lambda sensor, *a: sensor.sample(*a, pinhole()), sensor, key, depth, normal
    )
    bare = compiled_cost(written_out, key, depth, 0.001)
    # It also looks which depths are there; an incidence takes more.
    assert found[0] <= bare[0] + 8 * depth.size
