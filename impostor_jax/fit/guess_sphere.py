"""First guess of a sphere from a depth image, with no user input.

Three spheres are proposed: through the points, by least squares; the one whose normals
the points have; and the one behind the nearest points that is as wide as the region
appears, which noise hardly moves. That which lies closest to the points comes first.
"""

__all__ = ["guess_spheres"]

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from impostor_jax.fit.rounds import FEWEST_POINTS, blank_where, median_of, round_through
from impostor_jax.fit.sphere_body import SphereBody
from impostor_jax.fit.surface import Samples

NEAR = 0.1
"""Share of the points, those in the middle of the view, that tell how near it is."""

WIDE = 0.81
"""Share of an even disc's points within nine tenths of its radius."""


def guess_spheres(samples: Samples) -> tuple[SphereBody, Bool[Array, " g"]]:
    """Spheres in the camera frame, the closest to the readings first.

    And which of them are any: readings may admit none.
    """
    with jax.default_matmul_precision("highest"):
        proposed = [_through(samples), _along_normals(samples), _behind(samples)]
    balls = jax.tree.map(lambda *fields: jnp.stack(fields), *proposed)
    away = jnp.linalg.norm(samples.points[None] - balls.center[:, None], axis=-1)
    radius = balls.radius[:, None]
    misfit = jnp.mean(jnp.minimum(jnp.abs(away - radius), 0.3 * radius), axis=1)
    misfit = jnp.where(balls.radius > 0, misfit, jnp.inf)
    order = jnp.argsort(misfit)
    dtype = jnp.result_type(float)
    balls = jax.tree.map(lambda field: field[order].astype(dtype), balls)
    are_balls = jnp.isfinite(misfit[order])
    return blank_where(~are_balls, balls), are_balls


def _through(samples: Samples) -> SphereBody:
    """By least squares."""
    are_all = jnp.ones((1, len(samples.points)), bool)
    fewest = FEWEST_POINTS * samples.copies
    found = round_through(samples.points.T[None], are_all, fewest=fewest)
    return SphereBody(found.center[0], found.radius[0])


def _along_normals(samples: Samples) -> SphereBody:
    """The center lies a radius from each point against its normal."""
    points, normals = samples.normal_points, samples.normals
    # The normals face the camera, from outside and from inside: r has a sign.
    middle, mean = points.mean(axis=0), normals.mean(axis=0)
    away = normals - mean[None]
    radius = jnp.sum((points - middle[None]) * away) / jnp.sum(away**2)
    radius = jnp.where(samples.num_normals >= FEWEST_POINTS, radius, jnp.nan)
    return SphereBody(middle - radius * mean, jnp.abs(radius))


def _behind(samples: Samples) -> SphereBody:
    """As wide as the points appear, behind the nearest of them."""
    distance = jnp.linalg.norm(samples.points, axis=1)
    rays = samples.points / distance[:, None]
    view = rays.mean(axis=0)
    view = view / jnp.linalg.norm(view)
    aside = jnp.linalg.norm(jnp.cross(rays, view[None]), axis=1)
    ordered = jnp.sort(aside)
    inner, wide = (ordered[round(share * len(ordered))] for share in (NEAR, WIDE))
    sine = jnp.minimum(jnp.sin(jnp.arcsin(wide) / 0.9), 0.98)
    near = median_of(distance, aside < inner)
    radius = near * sine / (1 - sine)
    return SphereBody(view * (near + radius), radius)
