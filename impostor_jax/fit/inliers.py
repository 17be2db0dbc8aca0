"""What lies on an estimate: readings and crossings, and which ends these show."""

__all__ = ["Compared", "Inliers", "compared", "inliers_of"]

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from impostor_jax.compiling import computed_once
from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.evidence import (
    Readings,
    Terms,
    crossing_terms,
    joined_readings,
    joined_terms,
    readings_of,
)
from impostor_jax.fit.problem import Problem
from impostor_jax.fit.solve import STAGES, spread_of

MIN_END_TERMS = 5
"""Fewest inlying readings of a cap, or crossings, that show an end; and fewest of
either that tell of any other coordinate."""

PART_OF_WIDTH = 0.3
"""Inlying readings of a cap, at least, in readings across it. A bottle's body has none;
of its shoulder 5 to 7 lay on the plane of one, on which a cap would have had 400."""


class Compared(NamedTuple):
    """What all views show, compared with an estimate.

    Attributes:
        bodies: The estimate, in each view's frame.
        of_views: What the readings of each say.
        readings: The same, one view after the other, in coordinates of the first.
        edges: What crossings of the edges say, in the same order.
        depth: That was read, in meters.
        length: What the sensor measures along a ray over depth.
        beside: How many pixels beside the region's border a reading stands for.
    """

    bodies: Sequence[AbstractBody]
    of_views: Sequence[Readings]
    readings: Readings
    edges: Terms
    depth: Float[Array, " n"]
    length: Float[Array, " n"]
    beside: Float[Array, " n"]

    @property
    def meters(self) -> Float[Array, " n"]:
        """What the readings differ by, as the sensor errs: of a scanner along rays."""
        readings = self.readings
        return jnp.where(readings.used, -readings.off * self.length, 0)


def compared(problem: Problem, body: AbstractBody) -> Compared:
    """Compare the views of a problem with an estimate in the first view's frame."""
    views, settings = problem.views, problem.settings
    bodies = [view.own(body) for view in views]
    of_views = computed_once(
        lambda: readings_of(problem, bodies, [view.noise for view in views])
    )
    edges = problem.of_each(
        lambda view, own: crossing_terms(
            view.edge, own, view.noise, settings.is_outline, STAGES[-1].place
        ),
        bodies,
    )
    return Compared(
        bodies=bodies,
        of_views=of_views,
        readings=joined_readings(of_views, views, body),
        edges=joined_terms(edges, views, body),
        depth=jnp.concatenate([view.pixels.depth for view in views]),
        length=jnp.concatenate([view.pixels.length for view in views]),
        beside=jnp.concatenate([view.beside for view in views]),
    )


class Inliers(NamedTuple):
    """Which readings and crossings lie on an estimate.

    Attributes:
        inlier: Readings within three of their standard deviations.
        crossing: Crossings within six.
        tells: Readings that tell of one surface.
        spread: Scatter of the readings, in standard deviations of the sensor.
        whitened: Residuals of the inliers; 0 of the others.
        squares: Sum of their squares.
        num_inliers: How many there are, at least 1.
        ends_seen: Which of the body's ends are seen.
        reach: How far the inliers see the wall towards each, from the center.
        num_telling: How many readings and crossings depend on each tangent coordinate.
    """

    inlier: Bool[Array, " n"]
    crossing: Bool[Array, " m"]
    tells: Bool[Array, " n"]
    spread: Float[Array, ""]
    whitened: Float[Array, " n"]
    squares: Float[Array, ""]
    num_inliers: Float[Array, ""]
    ends_seen: Bool[Array, " e"]
    reach: Float[Array, " e"]
    num_telling: Float[Array, " c"]

    @property
    def variance(self) -> Float[Array, ""]:
        """Of the whitened residuals, at least the sensor's."""
        return jnp.maximum(self.squares / self.num_inliers, 1)


def inliers_of(told: Compared, body: AbstractBody, unit: Float[Array, ""]) -> Inliers:
    """What lies on an estimate.

    Args:
        told: What the views show, compared with it.
        body: The estimate, in the first view's frame.
        unit: Noise of a typical reading, in meters.
    """
    readings, edges = told.readings, told.edges
    terms, seen, used = readings.terms, readings.passing, readings.used
    spread = spread_of(terms.residual, used)

    def is_near() -> Bool[Array, " n"]:
        # The residuals take a cap for a whole plane; readings beyond its rim are not
        # on it.
        return used & (jnp.abs(terms.residual) <= 3 * spread) & ~seen.is_past_rim

    inlier = computed_once(is_near)
    crossing = (edges.weight > 0) & (jnp.abs(edges.residual) < 6)
    whitened = jnp.where(inlier, terms.residual, 0)
    slack = 3 * spread / jnp.where(terms.weight > 0, terms.weight, 1)
    shown = jnp.where(terms.weight > 0, body.end_shown(seen, told.depth, slack), 0)
    ends = jnp.array(body.ends, shown.dtype)[:, None]
    counts = jnp.sum(inlier[None] & (shown[None] == ends), axis=1)
    beside = jnp.sum(inlier & (shown == 0)).astype(told.depth.dtype)
    least = PART_OF_WIDTH * body.width_of_ends(beside)
    counts = jnp.where(counts.astype(least.dtype) >= least, counts, 0)
    counts += jnp.sum(crossing[None] & (edges.end[None] == ends), axis=1)
    outward = jnp.where(inlier[None], body.outward(seen), -jnp.inf)
    num_telling = jnp.sum(inlier[None] & (terms.gradient != 0), axis=1)
    num_telling += jnp.sum(crossing[None] & (edges.gradient != 0), axis=1)
    return Inliers(
        inlier=inlier,
        crossing=crossing,
        # A reading of the wall that grazes it beside a rim may be the cap's as well:
        # one of them, if it counts, tells more of the radius than all others.
        tells=inlier & ~(readings.is_square & seen.is_beside_rim(unit)),
        spread=spread,
        whitened=whitened,
        squares=jnp.sum(whitened**2),
        num_inliers=jnp.maximum(jnp.sum(inlier), 1).astype(told.depth.dtype),
        ends_seen=counts >= MIN_END_TERMS,
        reach=jnp.max(outward, axis=1, initial=-jnp.inf),
        num_telling=num_telling,
    )
