from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from tests.cases import CAMERAS, pose
from tests.checks import all_finite
from tests.groups import FULL
from tests.rendering import exact

# All at least 3 px wide in the pinhole camera of 64 x 48 pixels.
SHAPES = {
    "across": ((0.02, -0.05, 1.0), (1, 0, 0), 0.1, 0.4),
    "oblique": ((0.02, -0.05, 1.0), (0.3, 0.8, 0.52), 0.2, 0.5),
    "cap nearly edge on": ((0.02, 0.25, 1.0), (0.001, 1, 0.02), 0.2, 0.5),
    "end on": ((0.0, 0.0, 1.0), (0, 0, 1), 0.2, 0.4),
    "end on beside the axis": ((0.05, 0.1, 1.0), (0, 0, 1), 0.2, 0.4),
    "wall nearly edge on": ((0.05, 0.2, 1.0), (0, 0, 1), 0.2, 0.4),
    "disc": ((-0.1, 0.05, 0.9), (0.5, 0.3, 0.7), 0.2, 0.001),
    "rod": ((0.0, 0.0, 1.2), (0.7, 0.7, 0.1), 0.032, 0.7),
    "small": ((0.2, 0.1, 2.0), (0.7, 0.2, 0.1), 0.055, 0.12),
    "partly out of view": ((0.45, 0.1, 1.0), (0.3, 0.8, 0.2), 0.2, 0.4),
    "close": ((0.0, 0.1, 0.5), (0.3, 0.8, 0.2), 0.4, 0.4),
    "partly behind the camera": ((0.2, 0.25, 0.1), (0.1, 0, 1), 0.15, 1.0),
}
# A cap exactly edge on makes the area's derivative jump.
MORE = {
    "cap edge on": ((0.02, 0.25, 1.0), (0, 1, 0), 0.2, 0.5),
    "thin": ((0.0, 0.0, 1.2), (0.7, 0.3, 0.1), 0.004, 0.7),
    "thinner": ((0.0, 0.0, 1.2), (0.7, 0.3, 0.1), 0.0004, 0.7),
    "disc edge on": ((-0.1, 0.05, 0.9), (0.5, 0.3, 0.0), 0.2, 0.001),
    "pipe beside the camera": ((0.3, 0.1, 0.2), (0.1, 0.3, 1), 0.1, 2.0),
    "wide wall, reaching behind": ((0.6, 0.0, 0.3), (0, 1, 0), 0.5, 10.0),
}


@cache
def expected(name, camera_name="pinhole"):
    camera = CAMERAS[camera_name]()
    shape = {**SHAPES, **MORE}[name]
    if camera.ray_field is None:
        return exact.coverage(exact.silhouette(shape, camera), camera)
    limit = 1.05 * np.abs([camera.ray_field.x, camera.ray_field.y]).max()
    polygon = exact.through_lens(exact.silhouette(shape), camera, limit)
    return exact.coverage(polygon, camera)


@cache
def expected_derivatives(name):
    return exact.derivatives(SHAPES[name], CAMERAS["pinhole"]())


@eqx.filter_jit
def coverage_and_slopes(cylinder, camera, weights):
    """Coverage, and the derivatives of its weighted sum in cylinder and camera."""

    def total(both):
        covered = ij.coverage(*both)
        return jnp.sum(weights * covered), covered

    slopes, covered = eqx.filter_grad(total, has_aux=True)((cylinder, camera))
    return covered, *slopes


def traced(camera):
    """Intrinsics as arrays, so that one compiled function serves all cameras."""
    fields = [jnp.asarray(getattr(camera, f)) for f in ("fx", "fy", "cx", "cy")]
    return eqx.tree_at(lambda c: [c.fx, c.fy, c.cx, c.cy], camera, fields)


def at_pinhole(shape, weights=None):
    camera = traced(CAMERAS["pinhole"]())
    weights = np.ones((camera.height, camera.width)) if weights is None else weights
    return coverage_and_slopes(ij.Cylinder(*shape), camera, jnp.asarray(weights, float))


def seven(slopes, axis):
    """Derivatives in `exact.PARAMETERS`."""
    slopes = jax.tree.map(lambda slope: np.asarray(slope, float), slopes)
    tilt = exact.tangents(axis) @ slopes.axis
    return np.array([*tilt, *slopes.center, slopes.radius, slopes.height])


def errors(covered, reference):
    """Absolute errors, and which pixels the outline crosses."""
    edge = (reference > 1e-9) & (reference < 1 - 1e-9)
    return np.abs(np.asarray(covered, float) - reference), edge


@FULL
@pytest.mark.parametrize("name", [*SHAPES, *MORE])
def test_every_pixel_has_the_area_inside_the_outline(name, dtype):
    covered, *slopes = at_pinhole({**SHAPES, **MORE}[name])
    assert covered.dtype == dtype
    error, edge = errors(covered, expected(name))
    assert edge.sum() > 15
    # The issue asks for 2e-3. Measured in both precisions: at most 1.2e-4, and 4e-3 in
    # a pixel that holds a corner; thin outlines are no worse.
    assert error[edge].mean() < 3e-4
    assert error.max() < 8e-3
    assert all_finite(slopes)


@pytest.mark.parametrize("name", SHAPES)
def test_derivative_of_the_area_in_all_seven_parameters(name):
    shape = SHAPES[name]
    _, slopes, _ = at_pinhole(shape)
    reference, scale = expected_derivatives(name)
    # Measured: 9e-4 at most, the polygon's own error included. What has no effect at
    # all has only the polygon's rounding.
    allowed = 5e-3 * scale + 1e-6 * scale.max()
    assert (np.abs(seven(slopes, shape[1]) - reference) <= allowed).all()


@cache
def weights_and_expected_derivatives():
    """Of the radius and the center's depth, by central differences."""
    shape, camera = SHAPES["oblique"], CAMERAS["pinhole"]()
    weights = np.random.default_rng(0).normal(size=(camera.height, camera.width))
    slopes = []
    for parameter in (4, 5):
        change = 0
        for sign in (1, -1):
            polygon = exact.silhouette(
                exact.moved(shape, parameter, sign * 1e-5), camera
            )
            change += sign * exact.coverage(polygon, camera)
        slopes.append(np.sum(weights * change) / 2e-5)
    return weights, slopes


def test_derivative_goes_to_the_pixels_that_the_outline_crosses():
    weights, reference = weights_and_expected_derivatives()
    _, slopes, _ = at_pinhole(SHAPES["oblique"], weights)
    found = np.array([slopes.center[2], slopes.radius], float)
    # The bend of a step decides which pixel it is in.
    np.testing.assert_allclose(found, reference, rtol=1e-2)


@FULL
@pytest.mark.usefixtures("double")
def test_a_lens_bends_the_outline_and_can_be_fitted():
    camera = CAMERAS["distorted"]()
    camera = eqx.tree_at(
        lambda c: (c.fx, c.cy), camera, (jnp.asarray(60.0), jnp.asarray(23.0))
    )
    u, v = np.meshgrid(np.linspace(0, 5, 64), np.linspace(1, 2, 48))
    weights = jnp.asarray(np.cos(u) * v)
    for name in ("oblique", "thin", "close"):
        cylinder = ij.Cylinder(*{**SHAPES, **MORE}[name])
        covered, *slopes = coverage_and_slopes(cylinder, camera, weights)
        error, edge = errors(covered, expected(name, "distorted"))
        # Measured: 1.2e-4 and 4e-3, as without a lens.
        assert error[edge].mean() < 3e-4
        assert error.max() < 8e-3
    # The last cylinder, with a change in the camera alone.
    for where, step in ((lambda c: c.fx, 0.1), (lambda c: c.distortion, 1e-3)):
        ahead, behind = (
            coverage_and_slopes(
                cylinder, eqx.tree_at(where, camera, where(camera) + s), weights
            )[0]
            for s in (step, -step)
        )
        numeric = float(jnp.sum(weights * (ahead - behind))) / (2 * step)
        # Steps of the outline fall differently in each call.
        assert float(jnp.sum(where(slopes[1]))) == pytest.approx(numeric, rel=5e-3)
    # A pixel that no light reaches is empty.
    assert covered[24, 32] == 1
    dark = camera.ray_field.x.copy()
    dark[24, 32] = np.inf
    camera = eqx.tree_at(lambda c: c.ray_field.x, camera, dark)
    assert coverage_and_slopes(cylinder, camera, weights)[0][24, 32] == 0


def test_inside_is_covered_and_behind_is_not():
    everywhere, *slopes = at_pinhole(((0, 0, 0), (0, 0.2, 1), 1.0, 50.0))
    assert (np.asarray(everywhere) == 1).all()
    assert all_finite(slopes)
    # On the wall, to the last bit.
    touching, *slopes = at_pinhole(((0.5, 0, 0), (0, 1, 0), 0.5, 2.0))
    assert all_finite((touching, slopes))
    for center in ((0.1, 0.1, -2.0), (3.0, 0.0, 0.5)):
        nowhere, *slopes = at_pinhole((center, (0, 0.2, 1), 0.5, 1.0))
        assert not np.asarray(nowhere).any()
        assert not seven(slopes[0], (0, 0.2, 1)).any()
        assert all_finite(slopes)


@FULL
def test_vmap_over_posed_cylinders_with_tiles_and_forward_derivatives():
    camera = CAMERAS["posed"]()
    names = ("oblique", "end on", "rod")
    cylinders = [ij.Cylinder(*SHAPES[n]).transformed(pose().inverse()) for n in names]
    batch = jax.tree.map(lambda *fields: jnp.stack(fields), *cylinders)
    corners = jnp.array([[4, 8], [10, 20], [6, 12]])
    grow = jax.tree.map(jnp.zeros_like, cylinders[0])
    grow = eqx.tree_at(lambda c: c.radius, grow, jnp.asarray(1.0))

    @jax.vmap
    def block(cylinder, corner):
        tile = ij.Tile(corner[0], corner[1], height=32, width=40)
        return jax.jvp(lambda c: ij.coverage(c, camera, tile), (cylinder,), (grow,))

    blocks, slopes = block(batch, corners)
    for i, name in enumerate(names):
        (row, col), reference = corners[i], expected(name)
        part = reference[row : row + 32, col : col + 40]
        error, edge = errors(blocks[i], part)
        assert error[edge].mean() < 3e-4
        if part.sum() == reference.sum():
            total = float(at_pinhole(SHAPES[name])[1].radius)
            assert float(slopes[i].sum()) == pytest.approx(total, rel=1e-3)
    with pytest.raises(ValueError, match="primitive must be a single one, got a batch"):
        ij.coverage(batch, camera)
