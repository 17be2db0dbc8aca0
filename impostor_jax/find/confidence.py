"""How sure a found cylinder is: a probability from what speaks for and against it.

The log-odds are a sum of what each fact tells, logistic regression on detections in
synthetic images of other seeds than any that is reported; experiments/find_accuracy
says how well calibrated they are.
"""

__all__ = [
    "ALLOWED",
    "FACTS",
    "confidence",
    "exactness",
    "facts_of",
    "probability",
]

import math

import numpy as np
from jaxtyping import Float

from impostor_jax.find.caps import Caps
from impostor_jax.find.deformation import Deformation
from impostor_jax.find.evidence import Evidence
from impostor_jax.find.rivals import Rivals
from impostor_jax.fit.result import Fit

FACTS: dict[str, float] = {
    "misfit": -2.51,
    "chi2": -6.59,
    "against": -5.77,
    "shape": -3.58,
    "cone": -52.55,
    "ball": -1.78,
    "vague": -3.29,
    "exact": 0.52,
    "size": 0.57,
    "rim": 2.75,
    "uneven": -5.30,
}
"""Name of each fact, and its weight."""

BIAS = 1.10
"""Log-odds where all facts are 0."""

ALLOWED = 0.02
"""Departure from a cylinder, over the radius, that is not held against it: no sensor is
as straight as that."""

MOST_UNEVEN = 0.1
"""Change of an outline from end to end, in radii, from which on more tells no more."""

SLOPES = (0.025, 0.045)
"""Of a wall against its axis, in radians: what is not held against it, and from where
on it is a cone. Drawn sensors tilt no right wall by more than two deviations and .02;
the bands of two real ones tilt cans by .0025 and .0064 more."""


def facts_of(
    evidence: Evidence,
    caps: Caps,
    shape: Deformation | None,
    rivals: Rivals | None = None,
    fit: Fit | None = None,
    noise: float = 1.0,
    uneven: float = 0.0,
) -> Float[np.ndarray, " f"]:
    """The facts, in the order of `FACTS`.

    Args:
        evidence: Of the wall.
        caps: At its ends.
        shape: How far it is from a cylinder; None where too little is seen.
        rivals: What else it may be; None where too little is seen, or before that is
            looked at.
        fit: Of it; None before it is fitted, where facts of it count as usual.
        noise: Factor of its sigma, from planes.
        uneven: How much its outline changes from end to end, in radii.
    """
    over, vague = 0.5, 0.5
    if shape is not None:
        departures = np.abs(shape.value) - 2 * shape.deviation - ALLOWED
        over = float(np.max(departures, initial=0.0))
        vague = shape.vague
    total = evidence.explained + evidence.behind + evidence.other
    size = evidence.explained + caps.size
    cone, ball = 0.0, 0.0
    if rivals is not None:
        cone = abs(rivals.slope) - 2 * rivals.deviation
        ball = min(max(1 + rivals.ball, 0.0), 1.5) ** 2
    chi2, exact = 1.0, 0.98
    if fit is not None:
        chi2 = float(fit.chi2) / noise**2
        exact = exactness(fit)
    return np.array(
        [
            math.log(max(evidence.misfit, 0.7) / 0.7),
            min(max(chi2 - 1, 0.0), 3.0),
            math.sqrt((evidence.behind + evidence.other) / total),
            math.sqrt(min(over, 1.0)),
            float(np.interp(cone, SLOPES, (0.0, 1.0))),
            ball,
            min(vague, 0.5),
            math.log(exact / (1 - exact)),
            math.log(size / 1000),
            min(caps.rim / np.pi, 1),
            min(uneven, MOST_UNEVEN) / MOST_UNEVEN,
        ]
    )


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
