"""The cylinder that most points are of, among others that are of something else."""

__all__ = ["surest_among"]

import numpy as np
from jaxtyping import Bool

from impostor_jax.clouds.cloud import cloud_of
from impostor_jax.clouds.confidence import confidence, facts_of
from impostor_jax.clouds.planes import planes_of
from impostor_jax.clouds.search import Request, belonging, searched
from impostor_jax.clouds.support import Support
from impostor_jax.fits.given_points import GivenPoints

SURE = 0.9
"""Probability that a cylinder is there, from which the other points are left out: a fit
of all of them has failed, which says that they are of something else."""

RADII = (1e-4, 1e3)
"""That are looked for, in meters."""


def surest_among(
    given: GivenPoints, level: float | None
) -> tuple[Support, Bool[np.ndarray, " n"]] | None:
    """The surest cylinder among points, in the world, and which points are of it.

    None where none is sure.

    Args:
        given: The points.
        level: Standard deviation of one, in meters; None if nobody tells.
    """
    cloud = cloud_of(given.ends, given.starts)
    request = Request(radius_range=RADII, sigma=level)
    found = searched(cloud, planes_of(cloud), request)
    chances = [confidence(facts_of(cloud, one.support)) for one in found]
    if max(chances, default=0.0) < SURE:
        return None
    # Of several that are sure, that of most points.
    sure = [one for one, chance in zip(found, chances, strict=True) if chance >= SURE]
    best = max(sure, key=lambda one: len(one.own)).support
    own = np.zeros(len(given.ends), bool)
    own[belonging(given.ends - cloud.middle, best, level or 0.0)] = True
    return best.moved(cloud.middle), own
