"""How sure a cylinder in a cloud is: a probability from what speaks for and against it.

As of `find.confidence` the log-odds are a sum of what each fact tells, logistic
regression on detections in drawn clouds of other seeds than any that is reported.
"""

__all__ = ["FACTS", "confidence", "facts_of"]

import math

import numpy as np
from jaxtyping import Float

from impostor_jax.clouds.cloud import Cloud
from impostor_jax.clouds.support import Support
from impostor_jax.find.confidence import ALLOWED, exactness, probability
from impostor_jax.find.deformation import Deformation, Wall, deformation
from impostor_jax.fit.result import Fit
from impostor_jax.fit.surface import at_most

FACTS: dict[str, float] = {
    "misfit": -5.79,
    "against": -6.27,
    "slope": -12.66,
    "shape": -7.85,
    "vague": -4.77,
    "size": 1.57,
    "arc": 0.19,
    "turned": -4.94,
    "length": 1.13,
    "exact": 0.49,
}
"""Name of each fact, and its weight."""

BIAS = -3.74
"""Log-odds where all facts are 0."""

FEWEST = 20
"""Points of a wall, away from its ends, that tell of its shape."""

MOST_POINTS = 5000
"""That are asked for it."""

INNER = 0.95
"""Part of a wall's length that is away from its ends."""


def facts_of(
    cloud: Cloud, support: Support, fit: Fit | None = None
) -> Float[np.ndarray, " f"]:
    """The facts, in the order of `FACTS`.

    Args:
        cloud: The points.
        support: What they say of a wall.
        fit: Of it; None before it is fitted, where its fact counts as usual.
    """
    slope, over, vague = 0.0, 0.0, 0.5
    shape = _departures(cloud, support)
    radius, half = support.wall.radius, support.length / 2
    if shape is not None:
        # A stem tapers by more than a radius, but not by more than a degree.
        taper = (abs(shape.value[0]) - 2 * shape.deviation[0]) * radius / half
        slope = max(float(taper) - ALLOWED, 0.0)
        others = np.abs(shape.value[1:]) - 2 * shape.deviation[1:] - ALLOWED
        over = float(np.max(others, initial=0.0))
        vague = shape.vague
    exact = 0.98 if fit is None else exactness(fit)
    return np.array(
        [
            math.log(max(support.misfit, 0.7) / 0.7),
            math.sqrt(support.inner + support.behind),
            math.sqrt(min(slope, 1.0)),
            math.sqrt(min(over, 1.0)),
            min(vague, 0.5),
            math.log(len(support.on) / 100),
            min(support.arc / np.pi, 1.0),
            support.turned,
            math.log(min(support.length / radius, 10.0)),
            math.log(exact / (1 - exact)),
        ]
    )


def confidence(facts: Float[np.ndarray, " f"]) -> float:
    """Probability that a cylinder is there; 0 where a fact is no number."""
    return probability(BIAS + float(facts @ np.array(list(FACTS.values()))))


def _departures(cloud: Cloud, support: Support) -> Deformation | None:
    """How far a surface is from a cylinder's; None where too few points tell."""
    wall, middle = support.wall, (support.low + support.high) / 2
    on = support.on[at_most(len(support.on), MOST_POINTS)]
    about = cloud.points[on] - wall.center
    half = max(support.length / 2, 1e-9)
    place = (about @ wall.frame[2] - middle) / half
    told = np.abs(place) < INNER
    if np.count_nonzero(told) < FEWEST:
        return None
    on, place = on[told], place[told]
    across = wall.across(cloud.points[on])
    distance = np.linalg.norm(across, axis=1)
    readings = Wall(
        pixels=on,
        place=place,
        out=(across @ wall.frame[:2]) / np.maximum(distance, 1e-300)[:, None],
        miss=distance / wall.radius - 1,
        deviation=np.full(len(on), max(wall.scatter / wall.radius, 1e-9)),
        middle=middle,
        half=half,
    )
    return deformation(wall.frame[2], readings, shared=1.0)
