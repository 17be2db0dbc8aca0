"""Pictures whose edges are areas, beside those of many rays a pixel."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from experiments.ray_tracing.edges import (
    SCENES,
    differences,
    gradient,
    picture,
    supersampled,
)
from impostor_jax.geometry.rays import Ray
from impostor_jax.primitives.plane import Plane
from tests.cases import PRIMITIVES, rays_at
from tests.checks import all_finite
from tests.groups import FULL, RELEASE

pytestmark = FULL
WIDTH, PARTS = 32, 16
HARD = {"bored can", "heightfield", "sector", "torus"}
"""Primitives without a formula of their outline's distance."""


def rmse(found, expected):
    return float(np.sqrt(np.mean((np.asarray(found, float) - expected) ** 2)))


def flat(tree):
    return np.concatenate([np.ravel(x) for x in jax.tree.leaves(tree)])


@RELEASE
@pytest.mark.parametrize("name", SCENES)
def test_picture_is_nearer_to_many_rays_than_four_are(name):
    seen = SCENES[name]()
    many = supersampled(seen, seen.given, WIDTH, PARTS)
    found = rmse(picture(seen, seen.given, WIDTH, edges="area"), many)
    hard, four = (rmse(supersampled(seen, seen.given, WIDTH, n), many) for n in (1, 2))
    # From .07 to .11 of hard edges' for outlines, .01 for shadows.
    assert found < hard / 7
    assert found < four / 2


@RELEASE
@pytest.mark.parametrize(
    ("name", "samples", "parts", "most"),
    [
        # 2.6, 0.7, 3.6 and 0.7 %, some of it the differences': of the ball's outline
        # those of 16x16 rays err by 5 %, and beside 64x64 the gradient does by 1.5 %.
        # Where two edges cross a pixel one counts; in smaller parts there are fewer.
        pytest.param("ball, outline", 1, 32, 0.045),
        pytest.param("ball, shadow", 1, PARTS, 0.015),
        pytest.param("can, outline", 2, PARTS, 0.045),
        pytest.param("can, shadow", 1, PARTS, 0.015),
    ],
)
def test_gradient_is_that_of_differences(name, samples, parts, most, double):
    seen = SCENES[name]()
    target = supersampled(seen, seen.target, WIDTH, parts)
    expected = flat(differences(seen, WIDTH, target, parts, 1e-3))
    size = np.linalg.norm(expected)
    effort = ij.Effort(samples=samples)
    found = gradient(seen, WIDTH, target, edges="area", effort=effort)
    assert all_finite(found)
    assert np.linalg.norm(flat(found) - expected) < most * size


@pytest.mark.parametrize("name", sorted(HARD))
def test_what_has_no_formula_has_hard_edges(name):
    primitive = PRIMITIVES[name]()
    assert primitive.outline_gap(rays_at(primitive)) is None


@pytest.mark.parametrize("name", sorted(set(PRIMITIVES) - HARD))
def test_outline_gap_is_positive_where_a_ray_meets(name):
    primitive = PRIMITIVES[name]()
    rays = rays_at(primitive)
    gap = primitive.outline_gap(rays)
    assert np.isfinite(gap).all()
    ends = [primitive.occluded(rays)]
    if not isinstance(primitive, Plane):
        # What lies behind the origin counts.
        ends.append(primitive.occluded(Ray(rays.origin, -rays.direction)))
        decided = np.abs(gap) > 1e-6
        meets = np.any(ends, axis=0)
        np.testing.assert_array_equal(np.asarray(gap > 0)[decided], meets[decided])
    else:
        starts = np.abs(primitive.implicit(rays.origin)) > 1e-6
        decided = starts & (np.abs(gap) > 1e-6)
        np.testing.assert_array_equal(
            np.asarray(gap > 0)[decided], np.asarray(ends[0])[decided]
        )
    slopes = jax.grad(lambda given: jnp.sum(given[0].outline_gap(given[1])))(
        (primitive, rays)
    )
    assert all_finite(slopes)


@pytest.mark.parametrize("name", ["cylinder", "frustum", "box"])
def test_crease_gap_changes_its_sign_with_the_part(name):
    primitive = PRIMITIVES[name]()
    rays = jax.tree.map(lambda x: jnp.tile(x, 20), rays_at(primitive))
    # Beside each of many rays others, that may meet the next surface.
    rng = np.random.default_rng(0)
    off = jax.tree.map(
        lambda x: jnp.asarray(rng.normal(0, 0.03, x.shape), x.dtype), rays.direction
    )
    beside = Ray(rays.origin, rays.direction + off)
    hits = [primitive.intersect(ray) for ray in (rays, beside)]
    parts = [hit.part for hit in hits]
    gaps = [primitive.crease_gap(ray, *parts) for ray in (rays, beside)]
    start_outside = np.asarray(primitive.implicit(rays.origin) > 0)
    differ = np.array(hits[0].mask & hits[1].mask & (parts[0] != parts[1]))
    differ &= start_outside & (
        np.asarray(parts[0] // 2 != parts[1] // 2) | (name != "box")
    )
    if name == "frustum":
        # From one cap to the other there is no crease.
        differ &= ~np.asarray(hits[0].on_cap & hits[1].on_cap)
    assert differ.sum() > 20
    changes = np.sign(np.asarray(gaps[0])) != np.sign(np.asarray(gaps[1]))
    # A pair of rays may pass a corner, where a third surface lies between.
    assert changes[differ].mean() > 0.9


@RELEASE
def test_cut_of_two_shapes_has_a_derivative(double):
    # A ball half in a floor, seen from above: only its height moves the cut.
    def red(height):
        turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
        pose = ij.RigidTransform(turn, (0.0, 0.0, 5.0))
        camera = ij.OrthographicCamera(
            40.0, 40.0, 31.5, 31.5, 64, 64, camera_from_world=pose
        )
        floor = ij.Plane((0.0, 0.0, 0.0), (0.0, -1.0, 0.0))
        ball = ij.Sphere(jnp.array([0.0, 1.0, 0.0]) * height, 0.6)
        colors = [ij.Material((1.0, 0.0, 0.0)), ij.Material((0.0, 0.0, 0.0))]
        scene = ij.Scene([ball, floor])
        lights = [ij.AmbientLight(1.0)]
        return jnp.sum(ij.trace(scene, camera, lights, colors, edges="area")[..., 0])

    # The cut is a circle of squared radius 0.36 - height^2, in pixels of 0.025 m.
    value, slope = jax.value_and_grad(red)(0.3)
    assert float(value) == pytest.approx(1600 * np.pi * (0.36 - 0.09), rel=5e-3)
    assert float(slope) == pytest.approx(-1600 * np.pi * 2 * 0.3, rel=0.02)


def test_misuse_is_named():
    scene = ij.Scene([ij.Sphere((0, 0, 3), 1)])
    lens = ij.PinholeCamera(8, 8, 5.5, 4.5, 12, 10, distortion=(-0.1, 0, 0, 0, 0))
    lights = [ij.AmbientLight(1.0)]
    with pytest.raises(ValueError, match='edges must be "hard" for a camera with a le'):
        ij.trace(scene, lens, lights, edges="area")
    with pytest.raises(ValueError, match="edges must be one of hard, area; got 'soft'"):
        ij.trace(scene, lens, lights, edges="soft")


@RELEASE
def test_vmap_and_jacfwd_agree_with_the_plain_call(double):
    camera = ij.PinholeCamera(12.0, 12.0, 5.5, 4.5, 12, 10)

    def color(radius):
        scene = ij.Scene([ij.Sphere(jnp.array([0.0, 0.0, 3.0]), radius)])
        return ij.trace(scene, camera, [ij.AmbientLight(1.0)], edges="area")

    radii = jnp.array([0.7, 0.9])
    plain = np.stack([color(radius) for radius in radii])
    np.testing.assert_allclose(jax.vmap(color)(radii), plain, atol=1e-12)
    forward = jax.jacfwd(color)(radii[0]).sum()
    backward = jax.grad(lambda radius: color(radius).sum())(radii[0])
    assert float(forward) == pytest.approx(float(backward), rel=1e-12)
    # The outline is a circle of less than 3 pixels: it bends within each.
    square = 0.49 / (9 - 0.49)
    slope = 3 * 144 * np.pi * 2 * 0.7 * 9 / (9 - 0.49) ** 2
    assert plain[0].sum() == pytest.approx(3 * 144 * np.pi * square, rel=0.02)
    assert float(forward) == pytest.approx(slope, rel=0.05)
