"""Outlines of scenes that move: coverage and losses, beside those of many rays."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from tests.cases import CAMERAS
from tests.checks import all_finite
from tests.groups import FULL, RELEASE

WIDTH, HEIGHT, PARTS = 32, 24, 16
SIDES = ("depth", "mask", "share", "beside")


def camera(parts=1):
    """With so many rays along each side of a pixel."""
    width, height = WIDTH * parts, HEIGHT * parts
    cx, cy = (parts * (c + 0.5) - 0.5 for c in (15.3, 11.6))
    return ij.PinholeCamera(28.0 * parts, 29.0 * parts, cx, cy, width, height)


def cans(shift=0.0):
    """Three, of which the first is in front of the second and moves to the right."""
    place = jnp.array([[-0.05, 0, 0.8], [0.12, 0.1, 1.1], [-0.35, -0.1, 1.0]])
    place += jnp.array([[1.0, 0, 0], [0, 0, 0], [0, 0, 0]]) * shift
    axis = jnp.array([[0.2, 1.0, 0.1], [1.0, 0.3, 0.2], [0.1, 1.0, 0.3]])
    radius, height = jnp.full(3, 0.12, axis.dtype), jnp.full(3, 0.4, axis.dtype)
    return ij.Cylinder(place, axis, radius, height)


def discs(shift=0.0):
    """As flat as no can is, and seen from above: only edges change the depth."""
    shapes = cans(shift)
    axis, height = jnp.zeros_like(shapes.axis).at[:, 2].set(1), shapes.height / 1000
    return ij.Cylinder(shapes.center, axis, shapes.radius, height)


def scene(shapes):
    """Before a wall."""
    return ij.Scene([shapes, ij.Plane((0, 0, 1.5), (0, 0, -1))])


def mean_of_parts(x):
    return np.asarray(x, float).reshape(HEIGHT, PARTS, WIDTH, PARTS).mean(axis=(1, 3))


@jax.jit
def coverage_and_slope(shift, weight):
    def total(shift):
        covered = ij.coverage(ij.Scene([cans(shift)]), camera())
        return jnp.sum(covered * weight), covered

    (_, covered), slope = jax.value_and_grad(total, has_aux=True)(shift)
    return covered, slope


@jax.jit
def loss_and_gradient(shapes, target, near, far):
    """Its value, maps and derivative in three cans before a wall."""

    def loss(shapes):
        maps = ij.render(scene(shapes), camera(), SIDES, near=near, far=far)
        return ij.depth_loss(maps, target, sigma=0.01, outline=True), maps

    return jax.value_and_grad(loss, has_aux=True)(shapes)


@FULL
@pytest.mark.usefixtures("double")
def test_coverage_of_a_scene_and_its_derivative_are_those_of_many_rays():
    weight = np.broadcast_to(np.sin(np.arange(WIDTH) / 4), (HEIGHT, WIDTH))

    def counted(shift):
        mask = ij.render(ij.Scene([cans(shift)]), camera(PARTS), ("mask",)).mask
        return mean_of_parts(mask)

    covered, slope = coverage_and_slope(jnp.asarray(0.0), jnp.asarray(weight))
    many, step = counted(0.0), 0.01
    hard = np.asarray(ij.render(ij.Scene([cans()]), camera(), ("mask",)).mask)
    off, off_hard = (np.sqrt(np.mean((x - many) ** 2)) for x in (covered, hard))
    # Where two outlines cross a pixel one of them counts.
    assert off < off_hard / 4
    assert covered.min() == 0
    assert covered.max() == 1
    expected = ((counted(step) - counted(-step)) * weight).sum() / (2 * step)
    assert abs(float(slope) - expected) < 0.08 * abs(expected)


@RELEASE
@pytest.mark.usefixtures("double")
def test_a_loss_with_outlines_falls_as_that_of_many_rays_does():
    """An edge between two depths, of which the target has one, moves to the other."""
    target = ij.render(scene(discs(0.06)), camera()).depth

    def counted(shift):
        depth = ij.render(scene(discs(shift)), camera(PARTS), ("depth",)).depth
        one = jnp.ones_like(depth)
        maps = ij.GeometryMaps(depth=depth, share=one, beside=jnp.inf * one)
        fine = jnp.repeat(jnp.repeat(target, PARTS, 0), PARTS, 1)
        return float(ij.depth_loss(maps, fine, sigma=0.01, outline=True))

    step = 0.01
    expected = (counted(step) - counted(-step)) / (2 * step)
    (value, _), gradient = loss_and_gradient(discs(), target, 0.0, 9.0)
    slope = float(gradient.center[0, 0])
    assert float(value) == pytest.approx(counted(0.0), rel=0.02)
    assert slope < 0
    assert abs(slope - expected) < 0.1 * abs(expected)


@FULL
@pytest.mark.parametrize(("near", "far"), [(0.0, 9.0), (0.8, 1.4)])
@pytest.mark.usefixtures("double")
def test_maps_and_gradients_are_finite_with_a_target_of_any_kind(near, far):
    target = np.array(ij.render(scene(cans(0.05)), camera()).depth)
    target[3], target[4], target[5] = 0, np.nan, -np.inf
    (value, maps), gradient = loss_and_gradient(cans(), target, near, far)
    assert np.isfinite(value)
    assert all_finite(gradient)
    assert float(jnp.abs(gradient.center).max()) > 0
    share, beside = np.asarray(maps.share), np.asarray(maps.beside)
    is_edge = share < 1
    assert 0.05 < is_edge.mean() < 0.5
    assert share.min() >= 0.5 - 1e-12
    assert np.isposinf(beside[~is_edge]).all()
    seen = beside[np.isfinite(beside)]
    assert seen.size > 20
    assert near < seen.min()
    assert seen.max() < far


@RELEASE
def test_nothing_counts_as_a_gap_and_no_reading_does_not():
    ball = ij.Sphere((0, 0, 1.0), 0.2)
    maps = ij.render(ball, camera(), SIDES)
    depth, mask = np.asarray(maps.depth), np.asarray(maps.mask)

    def loss(target):
        return float(ij.depth_loss(
            maps, target, sigma=0.01, kernel="squares", outline=True, gap=0.05
        ))  # fmt: skip

    empty, unknown = np.full_like(depth, np.inf), np.zeros_like(depth)
    # Whatever is seen of the ball differs from nothing by 5 standard deviations.
    covered = np.asarray(ij.coverage(ball, camera()))
    assert loss(empty) == pytest.approx(25 * covered.mean(), rel=0.01)
    assert loss(unknown) == 0
    inner = np.asarray(maps.share) == 1
    assert loss(np.where(mask & inner, depth, 0)) == 0
    assert loss(np.where(mask & inner, depth + 0.02, 0)) == pytest.approx(4, rel=1e-3)
    assert loss(np.where(mask & inner, depth + 3, 0)) == pytest.approx(25, rel=1e-3)


@pytest.mark.parametrize("name", ["distorted", "spherical"])
def test_rays_that_are_known_at_centers_alone_are_refused(name):
    with pytest.raises(ValueError, match="outputs must hold no share and no beside"):
        ij.render(scene(cans()), CAMERAS[name](), SIDES)
    with pytest.raises(ValueError, match="must be a single shape, not a Scene"):
        ij.coverage(scene(cans()), CAMERAS[name]())


def test_a_loss_without_sides_is_refused():
    maps = ij.GeometryMaps(depth=jnp.ones((HEIGHT, WIDTH)))
    with pytest.raises(ValueError, match="maps must hold share and beside"):
        ij.depth_loss(maps, maps, outline=True)
    with pytest.raises(ValueError, match="gap must be a positive number"):
        ij.depth_loss(maps, maps, gap=0.0)
