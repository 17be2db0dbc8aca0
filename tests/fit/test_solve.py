"""Where a fit ends, and how that follows what it was given."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import impostor_jax as ij
from impostor_jax.fit.fittable import SPHERE
from impostor_jax.fit.options import Options
from impostor_jax.fit.problem import Inputs, posed
from impostor_jax.fit.request import checked_noise, checked_prior, checked_settings
from impostor_jax.fit.seen import Seen, shown_by
from impostor_jax.fit.solve import solve, spread_of
from impostor_jax.fit.sphere_body import SphereBody
from tests.checks import QUICKLY
from tests.fit.scenes import CAMERA, SIGMA, can, image, image_of
from tests.fit.test_sphere import ball
from tests.groups import FULL, SMALL_IMAGES

quick_solve = jax.jit(solve, compiler_options=QUICKLY)


def problem_of(tolerance, prior=None, meaning="region"):
    """A ball's, in double precision."""
    depth, mask = image_of(ball())
    kind, noise = SPHERE, checked_noise(SIGMA)
    options = Options(mask_meaning=meaning, prior=prior)
    settings = checked_settings(kind, options, ball(), SIGMA)
    settings = dataclasses.replace(settings, tolerance=tolerance)
    shown = shown_by(Seen(depth.astype(float), mask, CAMERA, noise))
    known = checked_prior(prior, kind.parameters, ball())
    shown = jax.tree.map(jnp.asarray, shown)
    return posed(Inputs(known, settings, (shown,), "geman_mcclure"))


def start():
    return SphereBody(
        jnp.asarray(ball().center, float), jnp.asarray(ball().radius, float)
    )


@FULL
@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("meaning", ["region", "outline"])
def test_a_fit_ends_where_its_steps_lead_nowhere(meaning):
    exact = quick_solve(problem_of(1e-5, meaning=meaning), start())
    assert bool(exact.converged)
    for tolerance in (0.2, 0.02):
        problem = problem_of(tolerance, meaning=meaning)
        found = quick_solve(problem, start())
        assert bool(found.converged)
        assert int(found.num_steps) < int(exact.num_steps)
    # In deviations of a position, of which a unit is ten; a few of the last steps.
    apart = jax.tree.map(jnp.subtract, found.body, exact.body)
    off = jnp.linalg.norm(jnp.append(apart.center, apart.radius))
    assert float(off / problem.unit * 10) < 3 * 0.02


@FULL
@pytest.mark.usefixtures("double")
def test_a_fit_does_not_hang_on_its_start():
    exact = quick_solve(problem_of(1e-5), start())
    for factor in (0.8, 1.2):
        other = dataclasses.replace(start(), radius=start().radius * factor)
        found = quick_solve(problem_of(1e-5), other)
        np.testing.assert_allclose(found.body.radius, exact.body.radius, rtol=1e-6)


@FULL
@pytest.mark.usefixtures("double")
def test_derivatives_follow_all_that_was_given():
    # What is held, expected, and seen of the outline counts in them as in the fit.
    prior = {"radius": (0.0505, 2e-5)}

    given, begin = problem_of(1e-6, prior=prior, meaning="outline"), start()

    def center(offset, expected):
        problem, depth = given, given.views[0].pixels.depth
        depth = jnp.where(depth > 0, depth + offset, 0)
        problem = dataclasses.replace(
            eqx.tree_at(lambda p: p.views[0].pixels.depth, problem, depth),
            prior=dataclasses.replace(
                problem.prior, radius=(expected, problem.prior.radius[1])
            ),
        )
        body = solve(problem, begin).body
        return jnp.stack([body.center[2], body.radius])

    at = jnp.zeros(()), jnp.asarray(0.0505)

    @jax.jit(compiler_options=QUICKLY)
    def both(*at):
        return center(*at), jax.jacfwd(center, argnums=(0, 1))(*at)

    _, slopes = both(*at)
    for number, slope in enumerate(slopes):
        step = [1e-6 * (number == which) for which in (0, 1)]
        above, below = (
            both(*(x + sign * h for x, h in zip(at, step, strict=True)))[0]
            for sign in (1, -1)
        )
        np.testing.assert_allclose(slope, (above - below) / 2e-6, rtol=1e-3, atol=1e-5)


@FULL
@SMALL_IMAGES
@pytest.mark.usefixtures("double")
def test_a_can_ends_within_its_tolerance():
    depth, mask = image()
    start = jax.tree.map(lambda x: np.asarray(x, float), can())
    exact, plain = (
        ij.fit_cylinder(
            *(depth.astype(float), CAMERA, mask, SIGMA, start),
            effort=ij.Effort(tolerance=tolerance),
        )
        for tolerance in (1e-4, 0.02)
    )
    for name in ("across_axis", "axis", "radius", "height"):
        std = np.asarray(getattr(exact.std, name))
        values = [
            np.asarray(f.cylinder.center if name == "across_axis" else
                       getattr(f.cylinder, name)) for f in (exact, plain)
        ]  # fmt: skip
        assert np.abs(values[0] - values[1]).max() < 0.05 * std.max(), name


@pytest.mark.parametrize("count", [1, 2, 50, 511, 512])
def test_spread_is_the_median(count, dtype):
    rng = np.random.default_rng(count)
    residual = 3 * rng.standard_t(2, 512).astype(dtype)
    used = np.arange(512) >= 512 - count
    found = float(jax.jit(spread_of)(residual, used))
    values = np.sort(np.abs(residual[used]))
    # The least value that half of them do not exceed, to a part of twice the mean.
    median = 1.4826 * values[(count - 1) // 2]
    finest = 1.4826 * 2 * values.mean() / 16**3
    assert max(median, 1) - 1e-5 <= found <= max(median + 1.01 * finest, 1)


def test_spread_is_at_least_one_and_has_no_derivative():
    small, used = jnp.full(512, 0.1), jnp.ones(512, bool)
    assert float(spread_of(small, used)) == 1
    assert float(spread_of(small, ~used)) == 1
    slope = jax.grad(lambda scale: spread_of(scale * jnp.arange(512.0), used))(2.0)
    assert float(slope) == 0
