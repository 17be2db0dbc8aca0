"""First guess of a sphere from a depth image, with no user input.

Three spheres are proposed: through the points, by least squares; the one whose normals
the points have; and the one behind the nearest points that is as wide as the region
appears, which noise hardly moves. That which lies closest to the points comes first.
"""

__all__ = ["guess_spheres"]

import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.surface import FEWEST_POINTS, Surface, round_through, surface_of

SphereGuess = tuple[Float[np.ndarray, "3"], float]
"""Center and radius, in the camera frame, in meters."""


def guess_spheres(
    depth: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    camera: PinholeCamera,
    sigma: float,
) -> list[SphereGuess]:
    """Guess spheres from the readings of a region.

    Args:
        depth: In meters; 0 where there is no reading.
        region: Pixels of the object.
        camera: Concrete; its pose is not used.
        sigma: Typical deviation of a reading, in meters.

    Returns:
        Centers and radii in the camera frame, the closest to the readings first; none
        where the readings admit no sphere.
    """
    surface = surface_of(depth, region, camera, sigma)
    if surface is None:
        return []
    proposed = [_through(surface.points), _along_normals(surface), _behind(surface)]
    guesses = [guess for guess in proposed if guess is not None]

    def misfit(guess: SphereGuess) -> float:
        center, radius = guess
        off = np.linalg.norm(surface.points - center, axis=1) - radius
        return float(np.mean(np.minimum(np.abs(off), 0.3 * radius)))

    return sorted(guesses, key=misfit)


def _through(points: Float[np.ndarray, "n 3"]) -> SphereGuess | None:
    """By least squares."""
    found = round_through(points.T[None], np.ones((1, len(points)), bool))
    radius = float(found.radius[0])
    return (found.center[0], radius) if radius > 0 else None


def _along_normals(surface: Surface) -> SphereGuess | None:
    """The center lies a radius from each point against its normal."""
    points, normals = surface.normal_points, surface.normals
    if len(points) < FEWEST_POINTS:
        return None
    # The normals face the camera, from outside and from inside: r has a sign.
    away_p, away_n = points - points.mean(axis=0), normals - normals.mean(axis=0)
    spread = np.sum(away_n**2)
    radius = float(np.sum(away_p * away_n) / spread) if spread > 0 else 0.0
    center = points.mean(axis=0) - radius * normals.mean(axis=0)
    return (center, abs(radius)) if radius else None


def _behind(surface: Surface) -> SphereGuess | None:
    """As wide as the points appear, behind the nearest of them."""
    distance = np.linalg.norm(surface.points, axis=1)
    rays = surface.points / distance[:, None]
    view = rays.mean(axis=0)
    view = view / np.linalg.norm(view)
    angle = np.arccos(np.clip(rays @ view, -1, 1))
    # In an even disc nine tenths of the radius hold 81 % of it.
    sine = np.sin(min(np.percentile(angle, 81) / 0.9, 1.4))
    near = distance[angle < np.percentile(angle, 10)]
    radius = float(np.median(near)) * sine / (1 - sine)
    return (view * (np.median(near) + radius), radius) if radius > 0 else None
