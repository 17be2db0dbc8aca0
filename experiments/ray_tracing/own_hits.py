"""How often a ray that starts at a surface meets that very surface again."""

__all__ = ["OFFSETS", "SHAPES", "hits_again"]

import jax
import jax.numpy as jnp
import numpy as np

import impostor_jax as ij
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.rendering.group import grouped
from impostor_jax.rendering.secondary import anchors, clearance

OFFSETS = ("by rounding", "0.001", "none")
"""How far off a surface rays start; 0.001 m along the ray is the published one."""

SHAPES = ("sphere", "cylinder", "box", "frustum")
"""Convex: a ray that leaves one never meets it."""


def hits_again(
    name: str, scale: float, distance: float, rays: int, rng: np.random.Generator
) -> np.ndarray:
    """Part of the hits from which a ray outwards meets the shape, of each offset.

    Args:
        name: Of the shape.
        scale: Its size, in meters.
        distance: From the camera, in sizes.
        rays: That are cast.
        rng: Draws place, attitude and rays.
    """
    center = _directions(rng, 1)[0] * distance * scale
    shape = _shape(name, center, scale, rng)
    to_hit = _directions_of(center + rng.uniform(-1, 1, (rays, 3)) * scale)
    counts, number = _counted(shape, _vectors(to_hit), _vectors(_directions(rng, rays)))
    return np.asarray(counts) / max(int(number), 1)


def _shape(name: str, center: np.ndarray, scale: float, rng: np.random.Generator):
    axis = _directions(rng, 1)[0]
    if name == "sphere":
        return ij.Sphere(_single(center), _single(scale))
    if name == "cylinder":
        sizes = _single(0.6 * scale), _single(1.5 * scale)
        return ij.Cylinder(_single(center), _single(axis), *sizes)
    if name == "frustum":
        reach = 0.7 * scale * axis
        radii = _single(0.6 * scale), _single(0.3 * scale)
        return ij.Frustum(_single(center - reach), _single(center + reach), *radii)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    size = _single(scale * np.array([1.0, 0.8, 1.2]))
    return ij.Box(_single(center), _single(turn), size)


@jax.jit
def _counted(shape: ij.AbstractPrimitive, to_hit: Vec3, away: Vec3):
    """Rays of each offset that meet the shape again, and all that met it once."""
    zero = jnp.zeros_like(to_hit.x)
    ray = Ray(Vec3(zero, zero, zero), to_hit)
    hit = shape.intersect(ray)
    t = jnp.where(hit.mask, hit.t, 0)
    normal, point = shape.normal(ray, hit), ray.at(t)
    anchor = jnp.broadcast_to(anchors(grouped([shape]))[0][0], (*t.shape, 4))
    off = clearance(ray, t, normal, (Vec3.from_array(anchor[..., :3]), anchor[..., 3]))
    away = away * jnp.where(normal.dot(away) < 0, -1, 1).astype(t.dtype)
    starts = (point + normal * off, point + away * 1e-3, point)
    again = [shape.intersect(Ray(start, away)).mask & hit.mask for start in starts]
    return jnp.stack([jnp.sum(each) for each in again]), jnp.sum(hit.mask)


def _directions(rng: np.random.Generator, count: int) -> np.ndarray:
    return _directions_of(rng.normal(size=(count, 3)))


def _directions_of(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _single(values) -> np.ndarray:
    return np.asarray(values, np.float32)


def _vectors(values: np.ndarray) -> Vec3:
    return Vec3.from_array(jnp.asarray(_single(values)))
