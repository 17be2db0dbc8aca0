"""What a silhouette shows of a body: its ends, its covariance, and whether it is one.

The coverages of a matte err each on its own. Of a mask of booleans the grid of pixels
errs: along an edge that is straight and lies along it all pixels are wrong alike, and
where it lies across it they take turns. So the variance of what all of them pull by is
that over all places that the grid could have had. What the edge errs by all along, and
each side of it by itself, adds to either.
"""

__all__ = ["assess_outline"]

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.fit.across import exact_rays
from impostor_jax.fit.agreement import reduced_chi2, tail
from impostor_jax.fit.alternatives import no_alternatives
from impostor_jax.fit.assess import Assessment
from impostor_jax.fit.body import AbstractBody, Rays, Readout, coordinates_of
from impostor_jax.fit.budget import if_known
from impostor_jax.fit.deviations import are_numbers, deviations_of
from impostor_jax.fit.form import no_form
from impostor_jax.fit.matte import GRID_SIGMA
from impostor_jax.fit.outline_solve import (
    OutlineProblem,
    Traced,
    coordinates,
    coverage_errors,
    scale_coordinate,
)
from impostor_jax.fit.prior import prior_residuals
from impostor_jax.fit.result import Fit
from impostor_jax.fit.robust import KERNELS, robust_residual
from impostor_jax.fit.silhouette import CHORD, coverage_of, distances, nearest
from impostor_jax.fit.solve import spread_of
from impostor_jax.fit.status import STATUSES, FitStatus, code_of_first
from impostor_jax.fit.uncertainty import covariance_root, sandwich_root
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import product, safe_divide
from impostor_jax.rendering.half_pixels import halves

MOST_CHI2 = 9.0
"""Reduced chi-squared up to which coverages may be of the shape, as of depths. Here it
holds for a sigma that is a guess, too: a matte that errs by thrice as much is none."""

MOST_HARD_CHI2 = 2.0
"""The same of a mask of booleans, whose pixels err by no more than the grid does."""

OFF_PLACE = 1.0
"""Pixels beside the outline, and three deviations of a coverage, from which a place of
the edge is not the body's."""

MOST_OFF = 0.12
"""Share of the edge's places that may lie elsewhere."""

MIN_PLACES = 5
"""Fewest places of the edge that show an end, and fewest of the wall."""

LEAST_HEIGHT = 4.0
"""Height, in its standard deviations, from which a wall is seen: a ball's disc is that
of a coin, too, or of the end of a can."""

PHASES = 8
"""Places of the grid, along rows and columns, that stand for all."""

TURN = np.radians(31.7)
"""Of the quarters of directions that an edge may face. A straight edge is of one; the
directions between two are in step with no grid."""


def assess_outline(problem: OutlineProblem, found: Traced) -> Assessment:
    """Result of a fit to a mask, in the world frame.

    Args:
        problem: What was given.
        found: The estimate.
    """
    prior, settings = problem.prior, problem.settings
    sign = problem.in_world(found.body).sign
    estimate = found.body.reversed(jnp.where(settings.keep_ends, 1, sign))
    places = _shown(problem, estimate)
    body, carried = estimate.drawn_in(
        places.ends_seen | ~jnp.asarray(settings.draws_in), places.reach
    )
    off = coverage_errors(problem, estimate)
    still = jnp.zeros(settings.free.shape[0], off.dtype)

    def covered(tangent: Float[Array, " c"]) -> Float[Array, " n"]:
        return coverage_of(estimate.retracted(tangent, settings.free), problem.pixels)

    slope = jax.jacfwd(covered)(still) / problem.sigma
    agreement = _agreement(off, slope, problem.is_pixel)
    chi2, count = agreement.chi2, agreement.total

    basis = coordinates(problem, body)
    # An end that is not seen is free; the ends are the last coordinates.
    leans = jnp.ones(basis.shape[0], basis.dtype)
    if body.ends:
        leans = leans.at[-len(body.ends) :].set(jnp.where(places.ends_seen, 1.0, 0.0))
    into = product(basis.T * leans[None], carried)
    moves = ~(problem.grows & (np.arange(len(into)) == scale_coordinate(body)))
    into = jnp.where(moves[:, None], into, 0)
    world = problem.in_world(body)

    def read(free: Float[Array, " c"]) -> tuple[Readout, Float[Array, " p"]]:
        moved = body.retracted(product(basis, free), settings.free)
        told = problem.in_world(moved).readout(world, places.ends_seen)
        return told, prior_residuals(prior, moved)

    change, known = jax.jacfwd(read)(still)
    for name in filter(change.__contains__, settings.held):
        change[name] = jnp.where(settings.held[name], 0, change[name])
    known = jnp.where((moves | problem.has_scale)[None], known, 0)
    slope = product(jnp.where(agreement.near[:, None], slope, 0), into.T)
    of_outline = product(slope.T, slope) / agreement.widening
    of_prior = product(known.T, known)
    root, directions, free = covariance_root(of_outline + of_prior)
    edge = _edge_of(problem, estimate, agreement.near, into)
    parts = {
        "outline": jnp.where(problem.is_hard, _of_grid(problem, edge), of_outline),
        # What is wider all along looks nearer: that leaves a shape known.
        "scale": _of_edge(problem, edge),
        "prior": of_prior,
    }
    independent = product(root, root.T)
    shares = {
        name: product(independent, part, independent) for name, part in parts.items()
    }
    of_all = jnp.sum(jnp.stack([*parts.values()]), axis=0)
    whole = sandwich_root(root, product(root.T, of_all, root))
    variance = jnp.sum(whole**2, axis=1)
    wider = safe_divide(variance, jnp.diagonal(independent))
    std, budget, covariance, observed, is_known = deviations_of(
        world, change, whole, shares, directions, free, is_outline=True
    )
    most = jnp.where(problem.is_hard, MOST_HARD_CHI2, MOST_CHI2)
    agrees = (chi2 < most) & (places.share_off <= MOST_OFF)
    finite = are_numbers(body, std, budget, covariance, chi2)
    height = std.height if "height" in std.names else None
    told = world.readout(world, places.ends_seen)
    if height is not None:
        # What may be as thin as a coin, or the end of anything, shows no wall.
        is_known &= places.wall_seen
        is_known &= (told["height"] > LEAST_HEIGHT * height) | ~jnp.isfinite(height)
    code = code_of_first(
        {
            FitStatus.NOT_FINITE: ~finite,
            FitStatus.POOR_FIT: ~agrees,
            FitStatus.UNDETERMINED: ~is_known,
            FitStatus.STEP_LIMIT: ~found.converged,
        }
    )
    success = code == STATUSES.index(FitStatus.CONVERGED)
    # Of what is left open all that is known is told.
    is_told = success | (code == STATUSES.index(FitStatus.UNDETERMINED))
    meters = problem.footprint * problem.sigma * estimate.center[2]

    marks = jnp.where(problem.is_pixel, jnp.where(agreement.near, 2, 1), 0)
    num_free = jnp.sum(jnp.any(settings.free != 0, axis=0)).astype(chi2.dtype)
    p_value = tail(chi2, count - num_free)
    has_p_value = problem.is_trusted & ~problem.is_hard
    fit = Fit(
        shape=world.shape,
        std=if_known(is_told, std),
        std_budget=if_known(is_told, budget),
        coordinates=coordinates_of(world),
        ends_seen=places.ends_seen,
        covariance=covariance,
        observed=observed,
        success=success,
        status_code=code,
        num_steps=found.num_steps,
        num_starts=jnp.ones((), int),
        num_agreeing=jnp.ones((), int),
        pixelwise=(),
        num_pixels=jnp.sum(problem.is_pixel),
        rms=jnp.sqrt(agreement.squares / count) * meters,
        chi2=chi2,
        tail=jnp.where(has_p_value, p_value, -1),
        border_chi2=jnp.zeros_like(chi2),
        alternatives=no_alternatives(world.shape),
        across=exact_rays(chi2.dtype),
        form=no_form(chi2.dtype),
        source="outline",
    )
    no = jnp.array(False)
    return Assessment(
        fit=fit,
        body=body,
        cost=jnp.where(finite, _cost(problem, estimate, off), jnp.inf),
        is_possible=finite,
        repeats=agreement.widening * jnp.maximum(jnp.max(wider), 1),
        is_clear=success,
        hides_tilt=no,
        hides_turn=no,
        ends_early=no,
        residual=(jnp.zeros_like(off),),
        marks=(marks.astype(jnp.int8),),
    )


class _Agreement(NamedTuple):
    """How coverages agree with those of an estimate.

    Attributes:
        near: Pixels whose coverage is within three deviations.
        total: Number of those that the outline crosses.
        squares: Sum of the squares of what these are off, in deviations.
    """

    near: Bool[Array, " n"]
    total: Float[Array, ""]
    squares: Float[Array, ""]

    @property
    def chi2(self) -> Float[Array, ""]:
        """Mean square, 1 where the deviations are right."""
        return reduced_chi2(self.squares, self.total)

    @property
    def widening(self) -> Float[Array, ""]:
        """Factor on variances, where coverages are off by more than they should."""
        return jnp.maximum(self.squares / self.total, 1)


def _agreement(
    off: Float[Array, " n"], slope: Float[Array, "n c"], is_pixel: Bool[Array, " n"]
) -> _Agreement:
    crossed = is_pixel & jnp.any(slope != 0, axis=1)
    near = is_pixel & (jnp.abs(off) <= 3 * spread_of(off, crossed))
    inlier = crossed & near
    return _Agreement(
        near=near,
        total=jnp.maximum(jnp.sum(inlier), 1).astype(off.dtype),
        squares=jnp.sum(jnp.where(inlier, off, 0) ** 2),
    )


def _cost(
    problem: OutlineProblem, body: AbstractBody, off: Float[Array, " n"]
) -> Float[Array, ""]:
    """Negative logarithm of a body's posterior probability, up to what all share."""
    width = KERNELS[problem.kernel][1]
    squares = jnp.sum(robust_residual(off, width, problem.kernel) ** 2)
    squares += jnp.sum(prior_residuals(problem.prior, body) ** 2)
    return jnp.where(jnp.isfinite(squares), squares / 2, jnp.inf)


class _Shown(NamedTuple):
    """What places of a mask's edge show of a body.

    Attributes:
        share_off: Share of them that lie elsewhere.
        ends_seen: Whether each end is.
        wall_seen: Whether the wall is.
        reach: How far towards each end the wall is seen, from the center.
    """

    share_off: Float[Array, ""]
    ends_seen: Bool[Array, " e"]
    wall_seen: Bool[Array, ""]
    reach: Float[Array, " e"]


def _shown(problem: OutlineProblem, body: AbstractBody) -> _Shown:
    edge = problem.edge
    places = distances(body, edge)
    distance, _ = nearest(places)
    # Of what a caller tells, not of the grid.
    slack = 3 * (problem.sigma - jnp.where(problem.is_hard, GRID_SIGMA, 0))
    on = problem.is_place & (jnp.abs(distance) < OFF_PLACE + slack)
    kind = jnp.argmin(places.distance, axis=0)
    rays = Rays(Vec3(edge.x, edge.y, jnp.ones_like(edge.x)))
    seen = body.passing(rays, CHORD * body.radius)
    # The end that faces away is the second margin, that towards the camera the third.
    ahead = jnp.sign(seen.local.direction.z)
    end = jnp.where(kind == 0, 0, jnp.where(kind == 1, ahead, -ahead))
    ends = jnp.array(body.ends, ahead.dtype)[:, None]
    ends_seen = jnp.sum(on[None] & (end[None] == ends), axis=1) >= MIN_PLACES
    on_wall = on & (end == 0)
    outward = jnp.where(on_wall[None], seen.along[None] * ends, -jnp.inf)
    total = jnp.maximum(jnp.sum(problem.is_place), 1).astype(distance.dtype)
    off = jnp.sum(problem.is_place & ~on).astype(distance.dtype)
    return _Shown(
        share_off=off / total,
        ends_seen=ends_seen,
        wall_seen=jnp.sum(on_wall) >= 2 * MIN_PLACES,
        reach=jnp.max(outward, axis=1),
    )


class _Edge(NamedTuple):
    """Pixels beside the edge of a mask, and how a body moves it there.

    Attributes:
        distance: How far within the outline each is, in pixels.
        normal: The way to the inside, along columns and rows.
        slope: Change of the distance by each coordinate; 0 of what does not count.
        part: Which pixels are of each quarter of directions of each margin, one a row.
    """

    distance: Float[Array, " n"]
    normal: Float[Array, "n 2"]
    slope: Float[Array, "n k"]
    part: Float[Array, "p n"]

    def pull(self, error: Float[Array, " n"]) -> Float[Array, "p k"]:
        """What errors of the coverages pull by, of each part."""
        return product(self.part, self.slope * error[:, None])


def _edge_of(
    problem: OutlineProblem,
    body: AbstractBody,
    near: Bool[Array, " n"],
    into: Float[Array, "k c"],
) -> _Edge:
    """The edge of an estimate.

    Pixels that are `near` count, and each row of `into` has the tangent coordinates
    that one of the others moves.
    """

    def distance_at(tangent: Float[Array, " c"]) -> Float[Array, " n"]:
        moved = body.retracted(tangent, problem.settings.free)
        return nearest(distances(moved, problem.pixels))[0]

    places = distances(body, problem.pixels)
    distance, normal = nearest(places)
    slope = jax.jacfwd(distance_at)(jnp.zeros(into.shape[1], into.dtype))
    slope = product(jnp.where(near[:, None], slope, 0), into.T)
    kind = jnp.argmin(places.distance, axis=0)
    facing = (jnp.arctan2(normal[:, 1], normal[:, 0]) - TURN) / (np.pi / 2)
    quarter = jnp.floor(facing).astype(int) % 4
    part = jax.nn.one_hot(4 * kind + quarter, 4 * places.distance.shape[0], axis=0)
    return _Edge(distance, normal, slope, part.astype(slope.dtype))


def _covered(edge: _Edge, distance: Float[Array, " n"]) -> tuple[Array, Array]:
    """Coverages by an outline at a distance from each pixel, and their slopes in it."""
    return jax.jvp(
        lambda s: halves(s, edge.normal).area, (distance,), (jnp.ones_like(distance),)
    )


def _of_grid(problem: OutlineProblem, edge: _Edge) -> Float[Array, "k k"]:
    """Variance of what pixels pull by over all places of the grid.

    Each quarter of directions of each margin has a place of its own: how far apart
    edges are, in the grid, nobody knows.
    """
    along = (np.arange(PHASES) + 0.5) / PHASES - 0.5
    steps = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)

    def with_phase(total: Float[Array, "k k"], step: Float[Array, "2"]):
        there = edge.distance + jnp.sum(edge.normal * step[None], axis=1)
        area, thins = _covered(edge, there)
        error = jnp.where(there > 0, 1, 0).astype(area.dtype) - area
        pull = edge.pull(thins * error) / problem.sigma**2
        return total + product(pull.T, pull), None

    size = edge.slope.shape[1]
    blank = jnp.zeros((size, size), edge.slope.dtype)
    total, _ = jax.lax.scan(with_phase, blank, jnp.asarray(steps, blank.dtype))
    return total / len(steps)


def _of_edge(problem: OutlineProblem, edge: _Edge) -> Float[Array, "k k"]:
    """The same of what the edge is off all along, and each part of it by itself."""
    _, thins = _covered(edge, edge.distance)
    pull = edge.pull(thins**2) * (problem.edge_sigma / problem.sigma**2)
    of_all = jnp.sum(pull, axis=0)
    return product(pull.T, pull) + of_all[:, None] * of_all[None]
