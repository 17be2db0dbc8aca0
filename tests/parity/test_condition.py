"""The bound that both sides are held to is what rounding of their inputs does."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.parity.compare import compare, rounding
from impostor_jax.parity.condition import condition_of
from impostor_jax.parity.judge import judge
from impostor_jax.parity.run import drawn_by_jax
from tests.groups import FULL, RELEASE

CAMERA = ij.PinholeCamera(150.0, 140.0, 10.0, 8.0, width=24, height=18)
CAN = ij.Cylinder((0.01, -0.01, 0.6), (0.6, 0.7, 0.3), 0.05, 0.08)


def test_a_sphere_straight_ahead_is_as_near_as_its_center_less_its_radius():
    ball = ij.Sphere((0.0, 0.0, 0.5), 0.02)
    found = condition_of(ball, CAMERA, drawn_by_jax(ball, CAMERA).index)
    assert found.depth[8, 10] == pytest.approx(0.5 + 0.02)
    assert found.normal[8, 10] == pytest.approx(0, abs=1e-6)
    # Towards its outline the ray grazes, and depth is hardly known.
    assert found.depth[8, 23] == 0, "not hit"
    assert found.depth.max() > 2


def moved(primitive, ray, step):
    """The primitive and the ray with one number after the other a step larger."""
    for name in ("center", "axis", "radius", "height"):
        field = np.asarray(getattr(primitive, name))
        # A direction is known to a part of its length.
        size = np.abs(field).max() if name == "axis" else np.abs(field)
        for k in range(field.size):
            one = np.zeros(field.size)
            one[k] = 1
            other = jnp.asarray(field + step * size * one.reshape(field.shape))
            yield eqx.tree_at(lambda p, n=name: getattr(p, n), primitive, other), ray
    for way in range(3):
        scale = np.ones(3)
        scale[way] += step
        d = Vec3.from_array(ray.direction.stack() * scale)
        yield primitive, Ray(ray.origin, d)


@RELEASE
def test_condition_is_the_sum_of_what_each_input_does(double):
    """By differences, of depth and then of the normal at a depth that is known so."""
    can, step = ij.Cylinder((0.01, -0.01, 0.6), (0.6, 0.7, 0.3), 0.05, 0.08), 1e-6
    maps = drawn_by_jax(can, CAMERA)
    found = condition_of(can, CAMERA, maps.index)
    assert set(np.unique(maps.part)) == {-1, 0, 1}, "wall and cap are seen"
    for row, col in ((8, 10), (5, 12), (10, 4)):
        ray = CAMERA.rays(jnp.asarray(row), jnp.asarray(col), can.dtype)
        hit = can.intersect(ray)
        normal = can.normal(ray, hit).stack()

        def normal_at(primitive, ray, t, hit=hit):
            return primitive.normal(ray, Hit(t, hit.on_cap, hit.part)).stack()

        depth, turn = 0.0, 0.0
        for other, bent in moved(can, ray, step):
            z = bent.at(other.intersect(bent).t).z
            depth += abs(z - maps.depth[row, col]) / step
            turn += jnp.linalg.norm(normal_at(other, bent, hit.t) - normal) / step
        deeper = normal_at(can, ray, hit.t + step)
        turn += depth * jnp.linalg.norm(deeper - normal) / step
        assert found.depth[row, col] == pytest.approx(float(depth), rel=1e-4)
        assert found.normal[row, col] == pytest.approx(float(turn), rel=1e-4, abs=1e-4)


@FULL
@pytest.mark.parametrize(("times", "holds"), [(2.5, True), (3.5, False)])
def test_one_pixel_beyond_what_its_inputs_determine_breaks_parity(times, holds):
    reference = drawn_by_jax(CAN, CAMERA)
    condition = condition_of(CAN, CAMERA, reference.index)
    row, col = np.unravel_index(np.argmax(condition.depth), condition.depth.shape)
    depth = reference.depth.astype(float)
    depth[row, col] += times * eps("float32") * condition.depth[row, col]
    drawn = dataclasses.replace(reference, depth=depth.astype(np.float32))
    apart = rounding(reference, drawn, condition)
    verdicts = {v.quantity: v for v in judge(compare(reference, drawn), *apart)}
    assert verdicts.pop("depth.worst").holds == holds
    assert all(verdict.holds for verdict in verdicts.values())
