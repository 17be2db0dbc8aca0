import math
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from experiments.oracle.outline import disc_support
from impostor_jax.numerics import eps
from impostor_jax.rendering.bounds import image_bounds
from tests.cases import CAMERAS
from tests.checks import all_finite, central_difference
from tests.rendering import exact
from tests.rendering.test_coverage import MORE, SHAPES

TWO_LINES = [
    "across", "oblique", "cap nearly edge on", "wall nearly edge on", "disc", "rod",
    "partly out of view", "partly behind the camera", "cap edge on", "thinner",
    "wide wall, reaching behind",
]  # fmt: skip
END_ON = ["end on", "end on beside the axis"]


@cache
def camera():
    return CAMERAS["pinhole"]()


def reach(cylinder, n):
    """How far the image reaches along each n: as far as the farther rim."""
    center, radius = np.asarray(cylinder.center, float), float(cylinder.radius)
    axis = exact.unit(cylinder.axis)
    ends = [center + s * float(cylinder.height) / 2 * axis for s in (-1, 1)]
    return [
        max(disc_support(m, end, axis, radius, math.sqrt) for end in ends) for m in n.T
    ]


def shape_of(name):
    return {**SHAPES, **MORE}[name]


def outline_of(name):
    return ij.outline(ij.Cylinder(*shape_of(name)), camera())


@pytest.mark.parametrize("name", TWO_LINES)
def test_two_lines_touch_the_wall_and_meet_the_arcs(name, dtype):
    center, axis, radius, height = shape_of(name)
    outline = outline_of(name)
    assert not bool(outline.inside | outline.end_on)
    lines = np.asarray(outline.lines, float)
    within = eps(dtype, 64) * np.linalg.norm(center)
    for start, end in lines:
        along = end - start
        assert np.linalg.norm(along) == pytest.approx(height, abs=within)
        # The plane through the camera and the line touches the wall: a radius away
        # from the axis.
        normal = np.cross(along, (start + end) / 2)
        off = abs(normal @ center) / np.linalg.norm(normal)
        assert off == pytest.approx(radius, abs=within)
    corners = np.asarray(outline.at(jnp.arange(5, dtype=dtype) % 4), float)
    np.testing.assert_allclose(corners[:4].reshape(2, 2, 3), lines, atol=within)
    # The far arc of a cap that is seen, the near one of the other.
    turns = np.abs(np.diff(np.asarray(outline.arcs))).ravel() > np.pi
    inward = [(center + s * height / 2 * exact.unit(axis)) @ exact.unit(axis) * s
              for s in (-1, 1)]  # fmt: skip
    np.testing.assert_array_equal(turns, np.array(inward) < 0)


@pytest.mark.parametrize("name", END_ON)
def test_end_on_the_outline_is_one_rim(name, dtype):
    outline = outline_of(name)
    assert bool(outline.end_on)
    start, stop = np.sort(np.asarray(outline.arcs), axis=1).T
    np.testing.assert_allclose(stop - start, [2 * np.pi, 0], rtol=eps(dtype, 8))
    assert np.ptp(np.asarray(outline.lines).reshape(-1, 3), axis=0).max() == 0
    points = np.asarray(outline.points(40), float)
    # The near cap, all the way round.
    center = np.array(shape_of(name)[0])
    np.testing.assert_allclose(points[:, 2], center[2] - 0.2, rtol=eps(dtype, 8))
    angle = np.unwrap(np.arctan2(*(points - center).T[:2]))
    assert abs(angle[-1] - angle[0]) > 1.9 * np.pi


@pytest.mark.parametrize("name", ["oblique", "end on", "disc", "partly out of view"])
def test_the_curve_is_the_hull_of_the_two_conics(name, dtype):
    outline = outline_of(name)
    image = np.asarray(outline.points(4000), float)
    image = image[:, :2] / image[:, 2:]
    angle = np.linspace(0, 2 * np.pi, 61)
    n = np.stack([np.cos(angle), np.sin(angle)])
    expected = reach(ij.Cylinder(*shape_of(name)), n)
    np.testing.assert_allclose((image @ n).max(0), expected, atol=1e-5)
    np.testing.assert_allclose(exact.area(image),
                               exact.area(exact.silhouette(shape_of(name))),
                               rtol=1e-4)  # fmt: skip
    # The images of both rims satisfy the equations of the conics.
    cylinder = outline.cylinder
    for end, conic in zip((-1, 1), np.asarray(outline.conics, float), strict=True):
        across = exact.tangents(shape_of(name)[1])
        ring = float(cylinder.radius) * (n.T @ across)
        middle = cylinder.center + end * cylinder.height / 2 * cylinder.axis
        rim = np.asarray(middle, float) + ring
        residual = np.einsum("ni,ij,nj->n", rim, conic, rim)
        scale = np.abs(conic).max() * (rim**2).sum(1)
        assert (np.abs(residual) < eps(dtype, 64) * scale).all()
        inner = np.asarray(middle, float)
        assert inner @ conic @ inner < 0


@pytest.mark.parametrize("name", ["oblique", "end on", "disc", "rod", "small", "thin"])
def test_box_is_that_of_the_silhouette(name, dtype):
    bounds = image_bounds(ij.Cylinder(*shape_of(name)), "planar")
    polygon = exact.silhouette(shape_of(name))
    # The polygon's vertices miss the extreme point by 1e-7 of the size.
    within = eps(dtype, 16) + 1e-6 * np.ptp(polygon, axis=0).max()
    for found, ends in ((-bounds.low, -polygon), (bounds.high, polygon)):
        reach = ends.max(0)
        room = eps(dtype, 8) * (1 + np.abs(reach))
        np.testing.assert_allclose(found, reach + room, atol=within)


def test_from_inside_there_is_no_outline_and_no_bounded_box():
    pipe = ij.Cylinder((0, 0, 0), (0, 0.2, 1), 1.0, 50.0)
    outline = ij.outline(pipe, camera())
    assert bool(outline.inside)
    assert not bool(outline.end_on)
    assert all_finite((outline.points(8), outline.lines, outline.arcs))
    for name in ("partly behind the camera", "wide wall, reaching behind"):
        bounds = image_bounds(ij.Cylinder(*shape_of(name)), "planar")
        assert np.isneginf(bounds.low).all()
        assert np.isposinf(bounds.high).all()
    assert np.isposinf(image_bounds(pipe, "planar").high).all()


@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("name", ["oblique", "end on"])
def test_the_outline_moves_as_its_points_on_the_body(name):
    cylinder = ij.Cylinder(*shape_of(name))
    across = jnp.asarray(exact.tangents(cylinder.axis)[0])
    tangent = jax.tree.map(lambda x: 0.3 * jnp.ones_like(x), cylinder)
    tangent = ij.Cylinder(tangent.center, across, tangent.radius, tangent.height)
    angle = np.linspace(0, 6, 61)
    n = np.stack([np.cos(angle), np.sin(angle)])

    @jax.jit
    def points_and_velocities(cylinder, tangent):
        def points(cylinder):
            return ij.outline(cylinder, camera()).points(4000)

        return jax.jvp(points, (cylinder,), (tangent,))

    still, moved = map(np.asarray, points_and_velocities(cylinder, tangent))
    image = still[:, :2] / still[:, 2:]
    velocity = (moved[:, :2] - image * moved[:, 2:]) / still[:, 2:]
    # Where a line with this normal touches the outline.
    best = np.argmax(image @ n, axis=0)
    found = np.sum(velocity[best] * n.T, axis=1)
    numeric = central_difference(lambda c: reach(c, n), cylinder, tangent)
    np.testing.assert_allclose(found, numeric, atol=2e-3)


def test_cylinder_that_is_not_whole_is_refused():
    can = ij.Cylinder((0, 0, 1), (0, 1, 0), 0.1, 0.3, 0.0, 2.0)
    camera = ij.PinholeCamera(60.0, 62.0, 31.5, 23.0, 64, 48)
    with pytest.raises(ValueError, match="must be closed and go all the way round"):
        ij.outline(can, camera)
    with pytest.raises(ValueError, match="must be closed and go all the way round"):
        ij.coverage(can, camera)
