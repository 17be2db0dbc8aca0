"""Rows of residuals: what they weigh, and their gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.body import Rays
from impostor_jax.fit.evidence import crossing_terms, reading_terms
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.fit.gather import table_of
from impostor_jax.fit.options import Options
from impostor_jax.fit.problem import Inputs, Pixels, posed
from impostor_jax.fit.regions import pixel_indices
from impostor_jax.fit.request import checked_prior, checked_settings
from impostor_jax.fit.round_body import RoundBody
from impostor_jax.geometry.vec3 import Vec3
from tests.fit.bodies import BODIES, body_of, in_double, rays
from tests.fit.scenes import CAMERA, SIGMA, can, image
from tests.groups import FULL

NOISE = ij.ConstantNoise(0.01)


def read_along(direction, depth):
    there = jnp.ones(depth.shape, bool)
    return Pixels(direction, depth, there, jnp.ones_like(depth))


@jax.jit
def readings_of(body, direction, offset, soft):
    """Residuals of readings beside a surface: by forward mode, and their gradients."""
    free = body.free_directions(())
    pixels = read_along(direction, body.passing(Rays(direction)).depth + offset)
    base = reading_terms(pixels, body, NOISE, soft)

    def residual(tangent):
        # The width of the blunted outline is held.
        moved = body.retracted(tangent, free)
        at = soft * body.radius / moved.radius
        return reading_terms(pixels, moved, NOISE, at).terms.residual

    def grazing(tangent):
        # Weights are held, and what is read follows the estimate's own half-chord.
        seen, own = body.retracted(tangent, free).passing(Rays(direction)), base.passing
        chord = jnp.sqrt(jnp.maximum(own.square, 0))
        sigma = NOISE.sigma(pixels.depth, pixels.depth)
        change = seen.nearest + seen.foot - own.nearest - own.foot
        error = seen.square - (chord - own.sign * change) ** 2
        bend = 2 * jnp.sqrt(chord**2 + sigma**2 / 2)
        return own.sign * error / bend * base.terms.weight

    still = jnp.zeros(len(free))
    plain = jax.jacfwd(residual)(still), jax.jacfwd(grazing)(still)
    return base, jnp.where(base.is_square[:, None], *plain[::-1])


@FULL
@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("soft", [0.0, 0.3])
@pytest.mark.parametrize("name", BODIES)
def test_gradient_of_a_reading_is_that_of_forward_mode(name, soft):
    shape = in_double(name)
    direction = rays(shape, np.float64)
    offset = jnp.asarray(np.random.default_rng(0).normal(0, 0.01, direction.x.shape))
    base, plain = readings_of(body_of(shape), direction, offset, jnp.asarray(soft))
    along = np.abs(base.passing.inverse) * np.asarray(direction.dot(direction)) > 9e3
    plain, found = np.asarray(plain)[~along], np.asarray(base.terms.gradient).T[~along]
    size = np.abs(plain).max(axis=1, keepdims=True) + 1e-3
    np.testing.assert_allclose(found / size, plain / size, atol=1e-9, equal_nan=False)


@FULL
def test_square_of_a_grazing_reading_is_unbiased():
    # A ray whose half-chord is one deviation; the depth itself would be off by a third
    # of a deviation on the mean of many readings.
    body = RoundBody.of(ij.Cylinder((0.0, 0.0, 0.8), (0, 1, 0), 0.04, 0.12))
    sigma, count = 0.001, 200_000
    x = np.sqrt(0.04**2 - sigma**2) / 0.8
    one = jnp.ones(count)
    direction = Vec3(one * np.float32(x), one * 0, one)
    depth = np.asarray(body.passing(Rays(direction)).depth)
    noise = np.random.default_rng(0).normal(0, sigma, count)
    pixels = read_along(direction, jnp.asarray((depth + noise).astype(np.float32)))
    readings = jax.jit(reading_terms)(pixels, body, ij.ConstantNoise(sigma))
    # Those that lie far behind by chance pull less, and are one in a thousand.
    # Beyond four deviations, where one in sixteen thousand is, outliers are.
    assert np.asarray(readings.is_square).mean() > 1 - 1e-4
    found = np.asarray(readings.terms.residual, float)
    # Four standard errors of a mean and of a deviation of a skewed residual.
    assert abs(found.mean()) < 4 / np.sqrt(count)
    assert found.std() == pytest.approx(1, abs=0.02)


def test_a_reading_that_is_none_weighs_nothing():
    body = RoundBody.of(can())
    _, mask = image()
    row, col = map(jnp.asarray, pixel_indices(mask))
    direction = CAMERA.rays(row, col, np.float32).direction
    blank = read_along(direction, jnp.zeros(row.shape, np.float32))
    terms = jax.jit(reading_terms)(blank, body, ij.ConstantNoise(SIGMA)).terms
    for part in (terms.residual, terms.gradient, terms.weight):
        assert not np.asarray(part).any()


def edge_of(depth, mask):
    settings = checked_settings(CYLINDER, Options(), None, SIGMA)
    known = checked_prior(None, CYLINDER.parameters, None)
    noise = ij.ConstantNoise(jnp.float32(SIGMA))
    table = table_of(depth, mask, *pixel_indices(mask), CAMERA, noise)
    problem = jax.jit(posed)(Inputs(known, settings, (table,), "squares"))
    return problem.views[0].edge


@jax.jit
def crossings(edge, body, tangent, place=0.02):
    """Terms of an outline, and the derivative of what it compares."""
    free = body.free_directions(())
    body = body.retracted(tangent, free)

    def terms_at(body):
        return crossing_terms(edge, body, ij.ConstantNoise(SIGMA), True, place)

    def error(change):
        terms = terms_at(body.retracted(change, free))
        return jnp.where(terms.weight > 0, terms.residual / terms.weight, 0)

    return terms_at(body), jax.jacfwd(error)(jnp.zeros(len(free)))


STILL = np.zeros(7, np.float32)


def from_corners(edge, truth):
    """Pixels from the nearest corner of a can's outline, where its wall meets a rim."""
    center, axis = np.asarray(truth.center), np.asarray(truth.axis)
    side = np.cross(axis, center / np.linalg.norm(center))
    side *= float(truth.radius) / np.linalg.norm(side)
    half = axis * float(truth.height) / 2
    corners = np.array([center + h + s for h in (half, -half) for s in (side, -side)])
    d = edge.pixels.direction
    pixels = np.stack([d.x[0], d.y[0]]) * CAMERA.fx
    at = corners[:, :2] / corners[:, 2:] * CAMERA.fx
    return np.linalg.norm(at[:, :, None] - pixels[None], axis=1).min(axis=0)


def test_every_crossing_of_the_truth_lies_between_its_pixels():
    # The gaps of opposite neighbors were compared to the last digit once, and lost one
    # crossing in ten.
    for degrees in (90.0, 60.0):
        depth, mask = image(degrees)
        edge = edge_of(depth, mask)
        terms, _ = crossings(edge, RoundBody.of(can(degrees)), STILL)
        weight, end = np.asarray(terms.weight), np.asarray(terms.end)
        at_edge = np.asarray(edge.pixels.exists[0])
        # Of pixels beside the corners an end's edge and the wall's tell nothing.
        away = at_edge & (np.asarray(from_corners(edge, can(degrees))) > 4)
        assert away.sum() > 0.7 * at_edge.sum()
        assert np.count_nonzero(weight[away]) > 0.95 * away.sum()
        assert set(end[weight > 0]) == {-1, 0, 1}
        # Within its interval a term has neither residual nor gradient.
        is_wall = (weight > 0) & (end == 0)
        residual, gradient = np.asarray(terms.residual), np.asarray(terms.gradient)
        within = is_wall & (residual == 0)
        # At corners an end's edge was taken for the wall's: a fit's interval held 60 %.
        np.testing.assert_array_equal(within, is_wall)
        assert not gradient[:, within].any()
        # Half a pixel is half the square root of 12 deviations; a rim is no line.
        is_end = (weight > 0) & (end != 0)
        assert np.abs(residual[is_end]).max() < 1.01 * 12**0.5 / 2


def test_gradient_of_an_end_is_that_of_forward_mode():
    depth, mask = image()
    # A few tenths of a pixel off, and so are all terms.
    tangent = np.float32([2e-3, -2e-3, 5e-4, 5e-4, 0.01, 5e-4, -5e-4])
    terms, plain = crossings(edge_of(depth, mask), RoundBody.of(can()), tangent)
    is_end = (np.asarray(terms.weight) > 0) & (np.asarray(terms.end) != 0)
    assert is_end.sum() > 20
    found = (np.asarray(terms.gradient) / np.where(is_end, terms.weight, 1)).T[is_end]
    plain = np.asarray(plain)[is_end]
    size = np.abs(plain).max()
    # The chord below which a root is blunted is held here; there it follows the radius.
    np.testing.assert_allclose(found / size, plain / size, atol=2e-3)


@FULL
@pytest.mark.parametrize("sign", [-1, 1])
def test_an_outline_pulls_the_radius_to_the_truth(sign):
    depth, mask = image()
    tangent = STILL + np.float32([0, 0, 0, 0, sign * 0.05, 0, 0])
    # A softness of a pixel is that of an estimate that may be so far off.
    terms, _ = crossings(edge_of(depth, mask), RoundBody.of(can()), tangent, 1.0)
    is_wall = (np.asarray(terms.end) == 0) & np.asarray(terms.gradient[4]).astype(bool)
    steps = -np.asarray(terms.residual / terms.gradient[4])[is_wall]
    assert is_wall.sum() > 20
    assert (sign * steps < 0).mean() > 0.9
    assert 0 < -sign * np.median(steps) < 0.05
