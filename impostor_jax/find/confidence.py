"""How sure a found cylinder is: a probability from what speaks for and against it.

The log-odds are a sum of what each fact tells, logistic regression on detections in
synthetic images of other seeds than any that is reported; experiments/find_accuracy
says how well calibrated they are.
"""

__all__ = ["FACTS", "confidence", "facts_of"]

import math

import numpy as np
from jaxtyping import Float

from impostor_jax.find.caps import Caps
from impostor_jax.find.deformation import Deformation
from impostor_jax.find.evidence import Evidence
from impostor_jax.fit.result import Fit

FACTS: dict[str, float] = {
    "misfit": -3.69,
    "chi2": -3.13,
    "against": -8.43,
    "taper": -20.05,
    "barrel": -22.54,
    "ellipse": 2.23,
    "bend": 19.79,
    "vague": 0.14,
    "exact": 0.34,
    "size": 0.90,
    "arc": 2.10,
    "hidden": -2.54,
    "rim": 1.39,
}
"""Name of each fact, and its weight."""

BIAS = 0.52
"""Log-odds where all facts are 0."""

ALLOWED = 0.02
"""Departure from a cylinder, over the radius, that is not held against it."""


def facts_of(
    evidence: Evidence,
    caps: Caps,
    shape: Deformation | None,
    fit: Fit | None = None,
    noise: float = 1.0,
) -> Float[np.ndarray, " f"]:
    """The facts, in the order of `FACTS`.

    Args:
        evidence: Of the wall.
        caps: At its ends.
        shape: How far it is from a cylinder; None where too little is seen.
        fit: Of it; None before it is fitted, where facts of it count as usual.
        noise: Factor of its sigma, from planes.
    """
    over, vague = np.full(6, 0.5), 0.5
    if shape is not None:
        over = np.maximum(np.abs(shape.value) - 2 * shape.deviation - ALLOWED, 0)
        vague = float(np.sqrt(np.mean(shape.deviation[:4] ** 2)))
    departures = [over[0], over[1], max(over[2:4]), max(over[4:6])]
    total = evidence.explained + evidence.behind + evidence.other
    size = evidence.explained + caps.size
    exact = 0.98 if fit is None else min(max(_exact(fit), 1e-3), 1 - 1e-3)
    return np.array(
        [
            math.log(max(evidence.misfit, 0.7) / 0.7),
            0.0 if fit is None else math.log(max(float(fit.chi2) / noise**2, 1.0)),
            math.sqrt((evidence.behind + evidence.other) / total),
            *np.sqrt(np.minimum(departures, 1)),
            math.log(vague / 0.02 + 1),
            math.log(exact / (1 - exact)),
            math.log(size / 1000),
            min(max(evidence.arc, caps.rim) / np.radians(120), 1),
            evidence.front / evidence.seen,
            min(caps.rim / np.pi, 1),
        ]
    )


def confidence(facts: Float[np.ndarray, " f"]) -> float:
    """Probability that a cylinder is there."""
    odds = BIAS + float(facts @ np.array(list(FACTS.values())))
    return 1 / (1 + math.exp(-min(max(odds, -50), 50)))


def _exact(fit: Fit) -> float:
    """Probability that radius, axis and place are within 10 %, 5 degrees, .15 radii."""
    radius = float(fit.cylinder.radius)

    def within(limit: float, deviation: float) -> float:
        return math.erf(limit / max(deviation, 1e-12) / math.sqrt(2))

    chance = within(0.1 * radius, float(fit.std.radius))
    chance *= within(math.radians(5), float(np.max(fit.std.axis)))
    return chance * within(0.15 * radius, float(np.max(fit.std.across_axis)))
