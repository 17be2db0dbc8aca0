"""First guess of a sphere from a depth image, with no user input.

Three spheres are proposed: through the points, by least squares; the one whose normals
the points have; and the one behind the nearest points that is as wide as the region
appears, which noise hardly moves. That which lies closest to the points comes first.
"""

__all__ = ["guess_spheres"]

import numpy as np
from jaxtyping import Float

from impostor_jax.fit.rounds import FEWEST_POINTS, Guess, median_of, round_through
from impostor_jax.fit.surface import Samples

NEAR = 0.1
"""Share of the points, those in the middle of the view, that tell how near it is."""

WIDE = 0.81
"""Share of an even disc's points within nine tenths of its radius."""

Sphere = tuple[Float[np.ndarray, "3"], float]


def guess_spheres(samples: Samples) -> list[Guess]:
    """Spheres, the closest to the readings first; these may admit none."""
    found = []
    for center, radius in (
        _through(samples),
        _along_normals(samples),
        _behind(samples),
    ):
        away = np.linalg.norm(samples.points - center, axis=1)
        misfit = np.mean(np.minimum(np.abs(away - radius), 0.3 * radius))
        if radius > 0 and np.isfinite(misfit):
            found.append((misfit, {"center": center, "radius": radius}))
    return [guess for _, guess in sorted(found, key=lambda pair: pair[0])]


def _through(samples: Samples) -> Sphere:
    """By least squares."""
    are_all = np.ones((1, len(samples.points)), bool)
    fewest = FEWEST_POINTS * samples.copies
    found = round_through(samples.points.T[None], are_all, fewest=fewest)
    return found.center[0], float(found.radius[0])


def _along_normals(samples: Samples) -> Sphere:
    """The center lies a radius from each point against its normal."""
    points, normals = samples.normal_points, samples.normals
    # The normals face the camera, from outside and from inside: r has a sign.
    middle, mean = points.mean(axis=0), normals.mean(axis=0)
    away = normals - mean
    radius = np.sum((points - middle) * away) / np.sum(away**2)
    if samples.num_normals < FEWEST_POINTS:
        radius = np.nan
    return middle - radius * mean, float(abs(radius))


def _behind(samples: Samples) -> Sphere:
    """As wide as the points appear, behind the nearest of them."""
    distance = np.linalg.norm(samples.points, axis=1)
    rays = samples.points / distance[:, None]
    view = rays.mean(axis=0)
    view = view / np.linalg.norm(view)
    aside = np.linalg.norm(np.cross(rays, view), axis=1)
    ordered = np.sort(aside)
    inner, wide = (ordered[round(share * len(ordered))] for share in (NEAR, WIDE))
    sine = min(np.sin(np.arcsin(wide) / 0.9), 0.98)
    radius = median_of(distance, aside < inner) * sine / (1 - sine)
    return view * (radius / sine), float(radius)
