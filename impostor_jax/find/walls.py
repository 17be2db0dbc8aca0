"""Walls of cylinders proposed from patches of points and their normals, in batches.

A wall has five numbers. The normals of a patch tell its axis, and with the points its
circle in closed form; a narrow thing, whose normals are lost in noise, is as wide as it
looks and as long as it is. Each such start is moved by robust Gauss-Newton steps to the
points of its patch, and the best of them to those of the whole object.
"""

__all__ = ["BATCH", "POINTS", "WIDE", "Patches", "Proposed", "propose"]

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.geometry.vec3 import Vec3

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
    each = jax.vmap(_of_patch, in_axes=(0, None, None))
    with jax.default_matmul_precision("highest"):
        return each(patches, grazing, log_limits)


def _of_patch(
    patch: Patches, grazing: Float[Array, ""], log_limits: Float[Array, "2"]
) -> Proposed:
    starts = _starts(patch)
    starts = starts._replace(log_radius=jnp.clip(starts.log_radius, *log_limits))
    own, wide = _Readings.of(patch.own), _Readings.of(patch.wide)
    narrowing = jnp.array(NARROWING, patch.error.dtype)

    def moved(wall: Wall, readings: "_Readings", scales: Float[Array, " s"]) -> Wall:
        def step(wall: Wall, scale: Float[Array, ""]) -> tuple[Wall, None]:
            return _stepped(wall, readings, grazing, log_limits, scale), None

        return jax.lax.scan(step, wall, scales)[0]

    walls = jax.vmap(lambda wall: moved(wall, own, narrowing))(starts)
    score = jax.vmap(lambda wall: _score(wall, own, grazing))(walls)
    _, index = jax.lax.top_k(score, BEST)
    best: Wall = jax.tree.map(lambda x: x[index], walls)
    ones = jnp.ones(STEPS, patch.error.dtype)
    wider = jax.vmap(lambda wall: moved(wall, wide, ones))(best)
    both: Wall = jax.tree.map(lambda *x: jnp.concatenate(x), wider, best)
    return Proposed(both, jax.vmap(lambda wall: _score(wall, wide, grazing))(both))


class _Readings(NamedTuple):
    """A cloud whose vectors are taken apart.

    Formulas of arrays (n, 3) took twice the time.
    """

    points: Vec3
    views: Vec3
    sigma: Float[Array, " n"]
    width: Float[Array, " n"]

    @staticmethod
    def of(cloud: Cloud) -> "_Readings":
        points, views = Vec3.from_array(cloud.points), Vec3.from_array(cloud.views)
        return _Readings(points, views, cloud.sigma, cloud.width)


class _Misfit(NamedTuple):
    """Places along the axis, directions from it, distances from the wall.

    The precision is the reciprocal of the distances' variance; 0 where another side
    than the wall's is seen.
    """

    along: Float[Array, " n"]
    out: Vec3
    miss: Float[Array, " n"]
    precision: Float[Array, " n"]


def _misfit(wall: Wall, readings: _Readings, grazing: Float[Array, ""]) -> _Misfit:
    axis = Vec3.from_array(wall.axis)
    off = readings.points - Vec3.from_array(wall.center)
    along = off.dot(axis)
    across = off - axis * along
    distance = jnp.sqrt(across.dot(across) + 1e-12)
    out = across * (1 / distance)
    cosine = -out.dot(readings.views)
    square = jnp.clip(cosine**2, 0.0025, 1)
    # Along the normal: the cosine of what it is along the ray.
    variance = readings.sigma**2 * (square + grazing * (1 - square))
    variance += (readings.width / 3) ** 2 * (1 - square)
    seen = wall.side * cosine > -0.1
    miss = distance - jnp.exp(wall.log_radius)
    return _Misfit(along, out, miss, jnp.where(seen, 1 / variance, 0))


def _stepped(
    wall: Wall,
    readings: _Readings,
    grazing: Float[Array, ""],
    log_limits: Float[Array, "2"],
    scale: Float[Array, ""],
) -> Wall:
    """Move a wall by one damped step of robust least squares."""
    along, out, miss, precision = _misfit(wall, readings, grazing)
    weight = precision / (1 + miss**2 * precision / (KERNEL * scale) ** 2) ** 2
    radius = jnp.exp(wall.log_radius)
    basis = tangent_basis(wall.axis)
    first, second = (out.dot(Vec3.from_array(basis[k])) for k in (0, 1))
    one = jnp.ones_like(along)
    rows = jnp.stack([first, second, along * first, along * second, one, along, miss])
    sums = (rows * weight[None]) @ rows.T
    total = jnp.maximum(sums[4, 4], 1e-30)
    # About the middle of what counts, so that shifts and tilts are independent. The
    # points need not be gone through again for that.
    middle = sums[4, 5] / total
    size = jnp.sqrt(jnp.maximum(sums[5, 5] / total - middle**2, 0)) + 0.1 * radius

    def centered(rows: Float[Array, "5 m"]) -> Float[Array, "5 m"]:
        return jnp.concatenate(
            [rows[:2], (rows[2:4] - middle * rows[:2]) / size, rows[4:]]
        )

    half = centered(sums[:5])
    products = centered(half[:, :5].T)
    damped = products + jnp.diag(0.02 * jnp.diag(products) + 1e-9 * jnp.trace(products))
    step = jax.scipy.linalg.solve(damped, half[:, 6], assume_a="pos")
    shift = jnp.clip(step[:2], -radius / 2, radius / 2)
    tilt = jnp.clip(step[2:4] / size, -0.3, 0.3)
    axis = wall.axis + tilt @ basis
    growth = jnp.clip(step[4] / radius, -0.4, 0.4)
    moved = Wall(
        center=wall.center + middle * wall.axis + shift @ basis,
        axis=axis / jnp.linalg.norm(axis),
        log_radius=jnp.clip(wall.log_radius + growth, *log_limits),
        side=wall.side,
    )
    good = jnp.all(jnp.isfinite(step))
    return jax.tree.map(lambda new, old: jnp.where(good, new, old), moved, wall)


def _score(
    wall: Wall, readings: _Readings, grazing: Float[Array, ""]
) -> Float[Array, ""]:
    """Part of the points that lie on a wall, each by its weight."""
    _, _, miss, precision = _misfit(wall, readings, grazing)
    weight = 1 / (1 + miss**2 * precision / KERNEL**2) ** 2
    return jnp.mean(jnp.where(precision > 0, weight, 0))


def _starts(patch: Patches) -> Wall:
    """Walls to begin with: for each likely axis one by normals and one by its width."""
    normals, error = patch.normals, patch.error
    known = jnp.isfinite(error)
    weight = jnp.where(known, 1 / (0.05 + error) ** 2, 0)
    weight = weight / jnp.maximum(jnp.sum(weight), 1e-9)
    _, vectors = jnp.linalg.eigh((normals.T * weight[None]) @ normals)
    axes = [_axis_near(vectors[:, k], normals, weight) for k in range(3)]
    for cloud in (patch.own, patch.wide):
        off = cloud.points - cloud.points.mean(axis=0, keepdims=True)
        axes.append(jnp.linalg.eigh(off.T @ off)[1][:, 2])
    middle = patch.own.points.mean(axis=0)

    def along(axis: Float[Array, "3"]) -> Wall:
        basis = tangent_basis(axis)
        points, out = (patch.own.points - middle[None]) @ basis.T, normals @ basis.T
        toward = patch.own.views.mean(axis=0) @ basis.T
        votes = jnp.where(jnp.abs(normals @ axis) < 0.5, weight, 0)
        circles = (_by_normals(points, out, votes, error), _by_width(points, toward))
        place, radius = (jnp.stack(part) for part in zip(*circles, strict=True))
        return Wall(
            center=middle[None] + place @ basis,
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
        axis = jnp.linalg.eigh((normals.T * votes[None]) @ normals)[1][:, 0]
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
    off, turn = points - point[None], out - normal[None]
    across = votes @ jnp.sum(off * turn, axis=1)
    spread = votes @ jnp.sum(turn**2, axis=1)
    noise = votes @ jnp.where(jnp.isfinite(error), error, 0) ** 2
    radius = across / jnp.maximum(spread - noise, 0.3 * spread + 1e-4)
    return point - radius * normal, radius


def _by_width(
    points: Float[Array, "n 2"], toward: Float[Array, "2"]
) -> tuple[Float[Array, "2"], Float[Array, ""]]:
    """Circle as wide as the points appear, behind those in its middle."""
    toward = toward / jnp.maximum(jnp.linalg.norm(toward), 1e-6)
    aside = jnp.stack([-toward[1], toward[0]])
    place, ahead = points @ aside, points @ toward
    low, high = -_outermost(-place), _outermost(place)
    radius, middle = jnp.maximum((high - low) / 2, 1e-6), (low + high) / 2
    near = jnp.abs(place - middle) < 0.4 * radius
    number = jnp.sum(near.astype(ahead.dtype))
    front = jnp.sum(jnp.where(near, ahead, 0)) / jnp.maximum(number, 1)
    return middle * aside + (front + 0.95 * radius) * toward, radius


def _outermost(place: Float[Array, " n"]) -> Float[Array, ""]:
    """The 0.98 quantile, which so takes a tenth of the time of sorting all."""
    rank = 0.02 * (place.shape[0] - 1)
    above = int(rank)
    highest, _ = jax.lax.top_k(place, above + 2)
    share = np.zeros(above + 2, place.dtype)
    share[above:] = 1 - (rank - above), rank - above
    return highest @ share
