"""Walls of cylinders proposed from patches of points and their normals, in batches."""

__all__ = ["Patches", "propose"]

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

BATCH = 64
POINTS = 128
WIDE = 256
KERNEL = 3.0


class Patches(NamedTuple):
    """Points of patches (b, n, ...), and of the objects that they are of (b, m, ...).

    Attributes:
        points, views, sigma, width, normals, error
    """

    points: jax.Array
    views: jax.Array
    sigma: jax.Array
    width: jax.Array
    normals: jax.Array
    error: jax.Array
    wide_points: jax.Array
    wide_views: jax.Array
    wide_sigma: jax.Array
    wide_width: jax.Array


class Wall(NamedTuple):
    center: jax.Array
    axis: jax.Array
    log_radius: jax.Array


def _basis(a):
    # Duff et al.
    s = jnp.where(a[2] >= 0, 1.0, -1.0)
    k = -1 / (s + a[2])
    b = a[0] * a[1] * k
    return jnp.array([1 + s * a[0] ** 2 * k, s * b, -s * a[0]]), jnp.array([b, s + a[1] ** 2 * k, -a[1]])


def _misfit(wall, points, views, sigma, width, grazing):
    off = points - wall.center
    t = off @ wall.axis
    across = off - t[:, None] * wall.axis
    rho = jnp.sqrt(jnp.sum(across**2, axis=1) + 1e-12)
    u = across / rho[:, None]
    cos = -jnp.sum(u * views, axis=1)
    c = jnp.clip(jnp.abs(cos), 0.05, 1)
    factor = jnp.interp(jnp.arccos(c), np.radians(np.arange(0, 90, 10)).astype(np.float32), grazing)
    s = jnp.sqrt((sigma * factor * c) ** 2 + (width / 3) ** 2 * (1 - c * c))
    return t, u, cos, rho - jnp.exp(wall.log_radius), s


def _step(wall, side, points, views, sigma, width, grazing, limits, scale, damping):
    t, u, cos, miss, s = _misfit(wall, points, views, sigma, width, grazing)
    e = miss / s
    w = 1 / (1 + (e / (KERNEL * scale)) ** 2) ** 2
    w = jnp.where(side * cos > -0.1, w, 0) / s**2
    b1, b2 = _basis(wall.axis)
    r = jnp.exp(wall.log_radius)
    u1, u2 = u @ b1, u @ b2
    # About the middle of what counts.
    mid = jnp.sum(w * t) / jnp.maximum(jnp.sum(w), 1e-30)
    size = jnp.sqrt(jnp.sum(w * (t - mid) ** 2) / jnp.maximum(jnp.sum(w), 1e-30)) + 0.1 * r
    rows = jnp.stack([-u1, -u2, -(t - mid) / size * u1, -(t - mid) / size * u2, -r * jnp.ones_like(t)])
    normal = (rows * w) @ rows.T
    normal = normal + jnp.diag(damping * jnp.diag(normal)) + 1e-9 * jnp.trace(normal) * jnp.eye(5)
    step = -jax.scipy.linalg.solve(normal, (rows * w) @ miss, assume_a="pos")
    bound = 0.5 * r
    shift = jnp.clip(step[:2], -bound, bound)
    tilt = jnp.clip(step[2:4] / size, -0.3, 0.3)
    axis = wall.axis + tilt[0] * b1 + tilt[1] * b2
    axis = axis / jnp.linalg.norm(axis)
    center = wall.center + mid * wall.axis + shift[0] * b1 + shift[1] * b2
    log_radius = wall.log_radius + jnp.clip(step[4], -0.4, 0.4)
    log_radius = jnp.clip(log_radius, limits[0], limits[1])
    new = Wall(center, axis, log_radius)
    good = jnp.all(jnp.isfinite(center)) & jnp.all(jnp.isfinite(axis)) & jnp.isfinite(log_radius)
    return jax.tree.map(lambda a, b: jnp.where(good, a, b), new, wall)


def _score(wall, side, points, views, sigma, width, grazing):
    _, _, cos, miss, s = _misfit(wall, points, views, sigma, width, grazing)
    e = miss / s
    inlier = jnp.where(side * cos > -0.1, 1 / (1 + (e / KERNEL) ** 2) ** 2, 0)
    return jnp.mean(inlier)


def _axis_of(normals, weight, axis):
    def again(axis, _):
        c = normals @ axis
        w = weight / (1 + (c / 0.25) ** 2) ** 2
        scatter = (normals.T * w) @ normals
        _, vectors = jnp.linalg.eigh(scatter)
        return vectors[:, 0], None
    axis, _ = jax.lax.scan(again, axis, None, length=2)
    return axis


def _starts(points, views, normals, error, wide_points):
    weight = jnp.where(jnp.isfinite(error), 1 / (0.05 + error) ** 2, 0)
    weight = weight / jnp.maximum(jnp.sum(weight), 1e-9)
    _, vectors = jnp.linalg.eigh((normals.T * weight) @ normals)
    axes = [_axis_of(normals, weight, vectors[:, k]) for k in range(3)]
    for some in (points, wide_points):
        off = some - some.mean(axis=0)
        _, v = jnp.linalg.eigh(off.T @ off)
        axes.append(v[:, 2])
    walls, sides = [], []
    for axis in axes:
        b1, b2 = _basis(axis)
        basis = jnp.stack([b1, b2])
        p, n = points @ basis.T, normals @ basis.T
        w = weight * jnp.where(jnp.abs(normals @ axis) < 0.5, 1, 0)
        w = w / jnp.maximum(jnp.sum(w), 1e-9)
        pm, nm = w @ p, w @ n
        dp, dn = p - pm, n - nm
        var = jnp.sum(w[:, None] * dn**2)
        noise = jnp.sum(w * jnp.where(jnp.isfinite(error), error, 0) ** 2)
        rho = jnp.sum(w[:, None] * dp * dn) / jnp.maximum(var - noise, 0.3 * var + 1e-4)
        center = pm - rho * nm
        walls.append((center @ basis, axis, jnp.abs(rho)))
        sides.append(jnp.sign(rho))
        # As wide as it appears.
        view = views.mean(axis=0) @ basis.T
        view = view / jnp.maximum(jnp.linalg.norm(view), 1e-6)
        aside = p @ jnp.array([-view[1], view[0]])
        ahead = p @ view
        low, high = jnp.quantile(aside, jnp.array([0.02, 0.98]))
        radius = jnp.maximum((high - low) / 2, 1e-4)
        mid = (low + high) / 2
        near = jnp.abs(aside - mid) < 0.4 * radius
        front = jnp.sum(jnp.where(near, ahead, 0)) / jnp.maximum(jnp.sum(near), 1)
        center = mid * jnp.array([-view[1], view[0]]) + (front + 0.95 * radius) * view
        walls.append((center @ basis, axis, radius))
        sides.append(jnp.array(1.0))
    c, a, r = (jnp.stack(parts) for parts in zip(*walls))
    return Wall(c, a, jnp.log(jnp.maximum(r, 1e-5))), jnp.stack(sides)


@partial(jax.jit, static_argnames=())
def propose(patches: Patches, grazing, limits):
    def one(p):
        starts, sides = _starts(p.points, p.views, p.normals, p.error, p.wide_points)
        starts = starts._replace(log_radius=jnp.clip(starts.log_radius, limits[0], limits[1]))
        # The line nearest to the points' middle.
        middle = p.points.mean(axis=0)
        shift = jnp.sum((middle - starts.center) * starts.axis, axis=1)
        starts = starts._replace(center=starts.center + shift[:, None] * starts.axis)
        own = (p.points, p.views, p.sigma, p.width, grazing)
        wide = (p.wide_points, p.wide_views, p.wide_sigma, p.wide_width, grazing)

        def refined(wall, side):
            def body(wall, scale):
                return _step(wall, side, *own, limits, scale, 0.02), None
            wall, _ = jax.lax.scan(body, wall, jnp.array([4.0, 3.0, 2.0, 1.5, 1.0, 1.0]))
            return wall, _score(wall, side, *own)

        walls, scores = jax.vmap(refined)(starts, sides)
        best, index = jax.lax.top_k(scores, 3)
        walls, sides = jax.tree.map(lambda x: x[index], (walls, sides))

        def widened(wall, side):
            def body(wall, scale):
                return _step(wall, side, *wide, limits, scale, 0.02), None
            wall, _ = jax.lax.scan(body, wall, jnp.array([2.0, 1.5, 1.0, 1.0, 1.0]))
            return wall, _score(wall, side, *wide)

        walls, wide_scores = jax.vmap(widened)(walls, sides)
        return walls, sides, best, wide_scores

    return jax.lax.map(one, patches, batch_size=16)
