"""Walls of cylinders proposed from patches of points and their normals, in batches.

A wall has five numbers. The normals of a patch tell its axis, and with the points its
circle in closed form; a narrow thing, whose normals are lost in noise, is as wide as it
looks and as long as it is. Each such start is moved by robust Gauss-Newton steps to the
points of its patch, and the best of them to those of the whole object.
"""

__all__ = ["BATCH", "POINTS", "WIDE", "Patches", "Proposed", "propose"]

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from impostor_jax.geometry.so3 import tangent_basis

BATCH = 64
"""Patches of one call, so that one program serves all images."""

POINTS, WIDE = 128, 256
"""Points of a patch, and of the object that it is of."""

BEST = 3
"""Walls of a patch that are moved to the points of the object."""

KERNEL = 3.0
"""Deviations at which a point's weight is a quarter (Geman and McClure's kernel)."""

NARROWING = (4.0, 3.0, 2.0, 1.5, 1.0, 1.0)
"""Factors of that, step by step, on a patch."""

STEPS = 5
"""On an object."""


class Cloud(NamedTuple):
    """Points of the camera frame, and how they are read.

    Attributes:
        points: In meters.
        views: Unit directions in which they are seen.
        sigma: Their standard deviation along that if they were seen face on, in meters.
        width: Of a pixel there, in meters.
    """

    points: Float[Array, "*b n 3"]
    views: Float[Array, "*b n 3"]
    sigma: Float[Array, "*b n"]
    width: Float[Array, "*b n"]


class Patches(NamedTuple):
    """Points of patches and of the objects that they are of, and normals of patches.

    Attributes:
        own: Of the patches.
        normals: Unit normals there that face the camera; zero where there is none.
        error: Their standard deviation, in radians; infinite where there is none.
        wide: Of the objects.
    """

    own: Cloud
    normals: Float[Array, "*b n 3"]
    error: Float[Array, "*b n"]
    wide: Cloud


class Wall(NamedTuple):
    """A point of the axis, the axis, the logarithm of the radius, and the side.

    The side is 1 where it is seen from outside, and -1 from inside.
    """

    center: Float[Array, "*b 3"]
    axis: Float[Array, "*b 3"]
    log_radius: Float[Array, "*b"]
    side: Float[Array, "*b"]


class Proposed(NamedTuple):
    """Walls of each patch, and the part of the object's points that lie on them."""

    wall: Wall
    score: Float[Array, "*b k"]


@jax.jit
def propose(
    patches: Patches, grazing: Float[Array, ""], log_limits: Float[Array, "2"]
) -> Proposed:
    """Propose walls of each of `BATCH` patches.

    Args:
        patches: What is looked at.
        grazing: How the variance of a reading grows with the square of the tangent of
            its incidence.
        log_limits: Logarithms of the smallest and largest radius.
    """

    def of_patch(patch: Patches) -> Proposed:
        starts = _starts(patch)
        starts = starts._replace(log_radius=jnp.clip(starts.log_radius, *log_limits))
        narrowing = jnp.array(NARROWING, patch.error.dtype)

        def moved(wall: Wall, cloud: Cloud, scales: Float[Array, " s"]) -> Wall:
            def step(wall: Wall, scale: Float[Array, ""]) -> tuple[Wall, None]:
                return _stepped(wall, cloud, grazing, log_limits, scale), None

            return jax.lax.scan(step, wall, scales)[0]

        walls = jax.vmap(lambda wall: moved(wall, patch.own, narrowing))(starts)
        score = jax.vmap(lambda wall: _score(wall, patch.own, grazing))(walls)
        _, index = jax.lax.top_k(score, BEST)
        own: Wall = jax.tree.map(lambda x: x[index], walls)
        ones = jnp.ones(STEPS, patch.error.dtype)
        wider = jax.vmap(lambda wall: moved(wall, patch.wide, ones))(own)
        both: Wall = jax.tree.map(lambda *x: jnp.concatenate(x), wider, own)
        score = jax.vmap(lambda wall: _score(wall, patch.wide, grazing))(both)
        return Proposed(both, score)

    return jax.lax.map(of_patch, patches, batch_size=16)


def _misfit(wall: Wall, cloud: Cloud, grazing: Float[Array, ""]) -> tuple[Any, ...]:
    """Places along the axis, directions from it, distances from the wall, deviations.

    Of points whose side is not seen the deviation is infinite.
    """
    off = cloud.points - wall.center
    along = off @ wall.axis
    across = off - along[:, None] * wall.axis
    distance = jnp.sqrt(jnp.sum(across**2, axis=1) + 1e-12)
    out = across / distance[:, None]
    cosine = -jnp.sum(out * cloud.views, axis=1)
    square = jnp.clip(cosine**2, 0.0025, 1)
    # Along the normal: the cosine of what it is along the ray.
    variance = cloud.sigma**2 * (square + grazing * (1 - square))
    variance += (cloud.width / 3) ** 2 * (1 - square)
    miss = distance - jnp.exp(wall.log_radius)
    seen = wall.side * cosine > -0.1
    return along, out, miss, jnp.where(seen, jnp.sqrt(variance), jnp.inf)


def _stepped(
    wall: Wall,
    cloud: Cloud,
    grazing: Float[Array, ""],
    log_limits: Float[Array, "2"],
    scale: Float[Array, ""],
) -> Wall:
    """Move a wall by one damped step of robust least squares."""
    along, out, miss, deviation = _misfit(wall, cloud, grazing)
    weight = 1 / (1 + (miss / deviation / (KERNEL * scale)) ** 2) ** 2 / deviation**2
    total = jnp.maximum(jnp.sum(weight), 1e-30)
    radius = jnp.exp(wall.log_radius)
    # About the middle of what counts, so that shifts and tilts are independent.
    middle = jnp.sum(weight * along) / total
    size = jnp.sqrt(jnp.sum(weight * (along - middle) ** 2) / total) + 0.1 * radius
    place = (along - middle) / size
    basis = tangent_basis(wall.axis)
    first, second = basis @ out.T
    rows = jnp.stack([first, second, place * first, place * second, 0 * along + 1])
    products = (rows * weight) @ rows.T
    damped = products + jnp.diag(0.02 * jnp.diag(products) + 1e-9 * jnp.trace(products))
    step = jax.scipy.linalg.solve(damped, (rows * weight) @ miss, assume_a="pos")
    shift = jnp.clip(step[:2], -radius / 2, radius / 2)
    tilt = jnp.clip(step[2:4] / size, -0.3, 0.3)
    axis = wall.axis + tilt @ basis
    moved = Wall(
        center=wall.center + middle * wall.axis + shift @ basis,
        axis=axis / jnp.linalg.norm(axis),
        log_radius=jnp.clip(
            wall.log_radius + jnp.clip(step[4] / radius, -0.4, 0.4), *log_limits
        ),
        side=wall.side,
    )
    good = jnp.all(jnp.isfinite(step))
    return jax.tree.map(lambda new, old: jnp.where(good, new, old), moved, wall)


def _score(wall: Wall, cloud: Cloud, grazing: Float[Array, ""]) -> Float[Array, ""]:
    """Part of the points that lie on a wall, each by its weight."""
    _, _, miss, deviation = _misfit(wall, cloud, grazing)
    seen = jnp.isfinite(deviation)
    weight = 1 / (1 + (miss / deviation / KERNEL) ** 2) ** 2
    return jnp.mean(jnp.where(seen, weight, 0))


def _starts(patch: Patches) -> Wall:
    """Walls to begin with: for each likely axis one by normals and one by its width."""
    normals, error = patch.normals, patch.error
    known = jnp.isfinite(error)
    weight = jnp.where(known, 1 / (0.05 + error) ** 2, 0)
    weight = weight / jnp.maximum(jnp.sum(weight), 1e-9)
    _, vectors = jnp.linalg.eigh((normals.T * weight) @ normals)
    axes = [_axis_near(vectors[:, k], normals, weight) for k in range(3)]
    for cloud in (patch.own, patch.wide):
        off = cloud.points - cloud.points.mean(axis=0)
        axes.append(jnp.linalg.eigh(off.T @ off)[1][:, 2])
    middle = patch.own.points.mean(axis=0)

    def along(axis: Float[Array, "3"]) -> Wall:
        basis = tangent_basis(axis)
        points, out = (patch.own.points - middle) @ basis.T, normals @ basis.T
        toward = patch.own.views.mean(axis=0) @ basis.T
        votes = weight * (jnp.abs(normals @ axis) < 0.5)
        circles = (_by_normals(points, out, votes, error), _by_width(points, toward))
        place, radius = (jnp.stack(part) for part in zip(*circles, strict=True))
        return Wall(
            center=middle + place @ basis,
            axis=jnp.stack([axis, axis]),
            log_radius=jnp.log(jnp.maximum(jnp.abs(radius), 1e-6)),
            side=jnp.where(radius < 0, -1.0, 1.0).astype(radius.dtype),
        )

    walls = jax.vmap(along)(jnp.stack(axes))
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), walls)


def _axis_near(
    axis: Float[Array, "3"], normals: Float[Array, "n 3"], weight: Float[Array, " n"]
) -> Float[Array, "3"]:
    """The direction across most normals, by those that are about across it now."""
    for _ in range(2):
        votes = weight / (1 + (normals @ axis / 0.25) ** 2) ** 2
        axis = jnp.linalg.eigh((normals.T * votes) @ normals)[1][:, 0]
    return axis


def _by_normals(
    points: Float[Array, "n 2"],
    out: Float[Array, "n 2"],
    votes: Float[Array, " n"],
    error: Float[Array, " n"],
) -> tuple[Float[Array, "2"], Float[Array, ""]]:
    """Circle p = c + r n by least squares; r is negative where it is seen from inside.

    Noise of the normals adds to their spread, and is taken off.
    """
    votes = votes / jnp.maximum(jnp.sum(votes), 1e-9)
    point, normal = votes @ points, votes @ out
    across = jnp.sum(votes[:, None] * (points - point) * (out - normal))
    spread = jnp.sum(votes[:, None] * (out - normal) ** 2)
    noise = jnp.sum(votes * jnp.where(jnp.isfinite(error), error, 0) ** 2)
    radius = across / jnp.maximum(spread - noise, 0.3 * spread + 1e-4)
    return point - radius * normal, radius


def _by_width(
    points: Float[Array, "n 2"], toward: Float[Array, "2"]
) -> tuple[Float[Array, "2"], Float[Array, ""]]:
    """Circle as wide as the points appear, behind those in its middle."""
    toward = toward / jnp.maximum(jnp.linalg.norm(toward), 1e-6)
    aside = jnp.stack([-toward[1], toward[0]])
    place, ahead = points @ aside, points @ toward
    low, high = jnp.quantile(place, jnp.array([0.02, 0.98], place.dtype))
    radius, middle = jnp.maximum((high - low) / 2, 1e-6), (low + high) / 2
    near = jnp.abs(place - middle) < 0.4 * radius
    front = jnp.sum(jnp.where(near, ahead, 0)) / jnp.maximum(jnp.sum(near), 1)
    return middle * aside + (front + 0.95 * radius) * toward, radius
