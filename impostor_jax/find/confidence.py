"""How sure a found cylinder is: a probability from what speaks for and against it.

The log-odds are a sum of what each fact tells, logistic regression on detections in
synthetic images of other seeds than any that is reported; experiments/find_accuracy
says how well calibrated they are.
"""

__all__ = [
    "ALLOWED",
    "FACTS",
    "Observed",
    "confidence",
    "exactness",
    "facts_of",
    "probability",
]

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from impostor_jax.find.caps import UNEVEN, Caps
from impostor_jax.find.continuation import NOTHING, Continuation
from impostor_jax.find.deformation import Deformation
from impostor_jax.find.evidence import Evidence
from impostor_jax.find.rivals import Rivals
from impostor_jax.fit.result import Fit

FACTS: dict[str, float] = {
    "misfit": -1.92,
    "chi2": -5.79,
    "against": -4.43,
    "shape": -3.62,
    "cone": -38.80,
    "ball": -1.86,
    "exact": 0.29,
    "size": 1.02,
    "rim": 1.69,
    "goes_on": -3.80,
    "edge": -5.13,
    "dome": -11.50,
    "shared": -0.40,
}
"""Name of each fact, and its weight."""

BIAS = 2.96
"""Log-odds where all facts are 0."""

ALLOWED = 0.02
"""Departure from a cylinder, over the radius, that is not held against it: no sensor is
as straight as that."""

MOST_SHARED = 6.0
"""Pixels that share an error from which on more tell no more."""

SLOPES = (0.025, 0.045)
"""Of a wall against its axis, in radians: what is not held against it, and from where
on it is a cone. Drawn sensors tilt no right wall by more than two deviations and .02;
the bands of two real ones tilt cans by .0025 and .0064 more."""


class Observed(NamedTuple):
    """What is known of a candidate without a fit.

    Attributes:
        evidence: Of the wall.
        caps: At its ends.
        shape: How far it is from a cylinder; None where too little is seen.
        rivals: What else it may be; None where too little is seen, or before that is
            looked at.
        around: What goes on beyond it.
        dome: How far the middle of its cap stands out, over the radius.
        shared: Pixels that share an error, from planes.
    """

    evidence: Evidence
    caps: Caps
    shape: Deformation | None
    rivals: Rivals | None = None
    around: Continuation = NOTHING
    dome: float = 0.0
    shared: float = 1.0


def facts_of(
    observed: Observed,
    fit: Fit | None = None,
    noise: float | None = 1.0,
) -> Float[np.ndarray, " f"]:
    """The facts, in the order of `FACTS`.

    Args:
        observed: What is known without a fit.
        fit: Of it; None before it is fitted, where facts of it count as usual.
        noise: Factor of its sigma, from planes; None where that is not all that its
            readings err by.
    """
    evidence, caps, shape, rivals, around, dome, shared = observed
    over = 0.5
    if shape is not None:
        departures = np.abs(shape.value) - 2 * shape.deviation - ALLOWED
        over = float(np.max(departures, initial=0.0))
    total = evidence.explained + evidence.behind + evidence.other
    size = evidence.explained + caps.size
    cone, ball, edge = 0.0, 0.0, 0.0
    if rivals is not None:
        cone = abs(rivals.slope) - 2 * rivals.deviation
        ball = min(max(1 + rivals.ball, 0.0), 1.5) ** 2
        edge = min(max(0.3 + rivals.edge, 0.0), 1.0)
    chi2, exact = 1.0, 0.98
    if fit is not None:
        if noise:
            chi2 = float(fit.chi2) / noise**2 * _beyond_roughness(fit)
        exact = exactness(fit)
    return np.array(
        [
            math.log(max(caps.misfit_with(evidence), 0.7) / 0.7),
            min(max(chi2 - 1, 0.0), 3.0),
            math.sqrt((evidence.behind + evidence.other) / total),
            math.sqrt(min(over, 1.0)),
            float(np.interp(cone, SLOPES, (0.0, 1.0))),
            ball,
            math.log(exact / (1 - exact)),
            math.log(size / 1000),
            min(caps.rim / np.pi, 1),
            min(around.off * around.on, 2.0) ** 0.25,
            edge,
            min(dome, 0.5),
            math.log(min(max(shared, 1.0), MOST_SHARED)),
        ]
    )


def _beyond_roughness(fit: Fit) -> float:
    """Part of the squares of what readings are off by that no roughness explains."""
    allowed = UNEVEN * float(fit.cylinder.radius)
    return max(1 - (allowed / max(float(fit.rms), 1e-12)) ** 2, 0.0)


def confidence(facts: Float[np.ndarray, " f"]) -> float:
    """Probability that a cylinder is there; 0 where a fact is no number."""
    return probability(BIAS + float(facts @ np.array(list(FACTS.values()))))


def probability(odds: float) -> float:
    """Of the logarithm of its odds; 0 where that is no number."""
    if math.isnan(odds):
        return 0.0
    return 1 / (1 + math.exp(-min(max(odds, -50), 50)))


def exactness(fit: Fit) -> float:
    """Probability that radius, axis and place are within 10 %, 5 degrees, .15 radii.

    Neither 0 nor 1, so that its odds are finite.
    """
    radius = float(fit.cylinder.radius)

    def within(limit: float, deviation: float) -> float:
        return math.erf(limit / max(deviation, 1e-12) / math.sqrt(2))

    chance = within(0.1 * radius, float(fit.std.radius))
    chance *= within(math.radians(5), float(np.max(fit.std.axis)))
    chance *= within(0.15 * radius, float(np.max(fit.std.across_axis)))
    return min(max(chance, 1e-3), 1 - 1e-3)
