"""Whitted's tracer by textbook formulas, in double precision and in numpy.

Of the package it only reads fields of shapes, materials and lights. A ray is solved
with the quadratic of a sphere, the slabs of a box, and a quadratic and two caps of a
cylinder; a secondary ray starts at the point itself and meets nothing nearer than
`NEAR`, which serves scenes of about a meter and nothing else.
"""

__all__ = ["Picture", "first_hit", "off_edges", "picture", "rays_of"]

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

import impostor_jax as ij

NEAR = 1e-7

Vectors = np.ndarray
"""(n, 3)."""


class Picture(NamedTuple):
    """Colors (h, w, 3), and a number of all that each pixel's rays have met (h, w)."""

    color: np.ndarray
    trail: np.ndarray


@dataclasses.dataclass(frozen=True)
class _World:
    shapes: Sequence[Any]
    materials: Sequence[ij.Material]
    lights: Sequence[Any]
    background: Any
    depth: int
    least: float


def picture(
    shapes: Sequence[Any],
    camera: ij.PinholeCamera,
    lights: Sequence[Any],
    materials: Sequence[ij.Material],
    background: Any = (0.0, 0.0, 0.0),
    depth: int = 3,
    least: float = 0.0,
) -> Picture:
    """Trace a picture.

    Args:
        shapes: Single spheres, planes, cylinders with caps and boxes.
        camera: Without a lens.
        lights: In the world frame.
        materials: One of each shape.
        background: Color of rays that meet nothing.
        depth: Most bounces.
        least: Part of a pixel from which on a ray is cast.
    """
    world = _World(shapes, materials, lights, background, depth, least)
    o, d = rays_of(camera)
    color, trail = _color(world, o, d, 0, np.ones(len(o)))
    size = (camera.height, camera.width)
    return Picture(color.reshape(*size, 3), trail.reshape(size))


def off_edges(camera: ij.PinholeCamera, *scene: Any, step: float = 0.01, **how: Any):
    """Pixels whose trail stays the same where they are moved by a part of a pixel.

    Args:
        camera: As of `picture`, from which shapes come first in `scene`.
        scene: Shapes, lights, materials and what else `picture` takes.
        step: In pixels, along the rows and the columns, to either side.
        how: Of `picture`, by name.
    """
    shapes, *rest = scene
    trail = picture(shapes, camera, *rest, **how).trail
    same = np.ones(trail.shape, bool)
    for right, down in ((step, 0), (-step, 0), (0, step), (0, -step)):
        moved = ij.PinholeCamera(
            camera.fx, camera.fy, camera.cx + right, camera.cy + down,
            camera.width, camera.height, camera_from_world=camera.camera_from_world,
        )  # fmt: skip
        same &= picture(shapes, moved, *rest, **how).trail == trail
    return same


def rays_of(camera: ij.PinholeCamera) -> tuple[Vectors, Vectors]:
    """Origins and unit directions of the pixels' rays in the world frame."""
    row, col = np.indices((camera.height, camera.width)).reshape(2, -1)
    k = camera.matrix()
    d = np.stack(
        [(col - k[0, 2]) / k[0, 0], (row - k[1, 2]) / k[1, 1], np.ones(row.shape)], 1
    )
    o = np.zeros_like(d)
    if camera.camera_from_world is not None:
        pose = camera.camera_from_world
        turn = np.asarray(pose.rotation, float)
        # Of a row vector: the inverse of a rotation is its transpose.
        d, o = d @ turn, (o - np.asarray(pose.translation, float)) @ turn
    return o, _unit(d)


def first_hit(
    shapes: Sequence[Any], o: Vectors, d: Vectors
) -> tuple[np.ndarray, np.ndarray, Vectors, np.ndarray]:
    """Ray parameter, shape (-1 for none), outward unit normal and face."""
    t, index = np.full(len(o), np.inf), np.full(len(o), -1)
    normal, face = np.zeros_like(o), np.zeros(len(o), int)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for k, shape in enumerate(shapes):
            for part, (s, n) in enumerate(_surfaces(shape, o, d)):
                s = np.where(s > NEAR, s, np.inf)
                nearer = s < t
                t = np.where(nearer, s, t)
                normal = np.where(nearer[:, None], n, normal)
                index, face = (
                    np.where(nearer, new, old)
                    for new, old in ((k, index), (part, face))
                )
    return t, index, normal, face


def _surfaces(shape: Any, o: Vectors, d: Vectors):
    """Where the rays cross each surface, NaN or infinite if nowhere, and its normal."""

    def field(name: str) -> np.ndarray:
        return np.asarray(getattr(shape, name), float)

    if isinstance(shape, ij.Sphere):
        w, r = o - field("center"), field("radius")
        b, a = _dot(w, d), _dot(d, d)
        root = np.sqrt(b * b - a * (_dot(w, w) - r * r))
        for t in ((-b - root) / a, (-b + root) / a):
            yield t, (w + t[:, None] * d) / r
    elif isinstance(shape, ij.Plane):
        n = field("unit_normal")
        n = n / np.linalg.norm(n)
        yield (field("point") - o) @ n / (d @ n), np.broadcast_to(n, o.shape)
    elif isinstance(shape, ij.Cylinder):
        axis = field("axis") / np.linalg.norm(field("axis"))
        w, r, half = o - field("center"), field("radius"), field("height") / 2
        w_a, d_a = w @ axis, d @ axis
        across, way = w - w_a[:, None] * axis, d - d_a[:, None] * axis
        b, a = _dot(across, way), _dot(way, way)
        root = np.sqrt(b * b - a * (_dot(across, across) - r * r))
        for t in ((-b - root) / a, (-b + root) / a):
            inside = np.abs(w_a + t * d_a) <= half
            yield np.where(inside, t, np.inf), (across + t[:, None] * way) / r
        for sign in (-1, 1):
            t = (sign * half - w_a) / d_a
            at = across + t[:, None] * way
            yield (
                np.where(_dot(at, at) <= r * r, t, np.inf),
                np.broadcast_to(sign * axis, o.shape),
            )
    elif isinstance(shape, ij.Box):
        turn, half = field("rotation"), field("size") / 2
        w, v = (o - field("center")) @ turn, d @ turn
        for k in range(3):
            others = [j for j in range(3) if j != k]
            for sign in (-1, 1):
                t = (sign * half[k] - w[:, k]) / v[:, k]
                at = w[:, others] + t[:, None] * v[:, others]
                inside = np.all(np.abs(at) <= half[others], axis=1)
                n = np.broadcast_to(sign * turn[:, k], o.shape)
                yield np.where(inside, t, np.inf), n
    else:
        raise ValueError(f"shape must be one with a formula here, got {shape!r}")


def _color(
    world: _World, o: Vectors, d: Vectors, level: int, weight: np.ndarray
) -> tuple[Vectors, np.ndarray]:
    """Colors that rays see, and their trails."""
    color, trail = np.zeros_like(o), np.zeros(len(o), np.uint64)
    cast = weight > world.least
    if not cast.any():
        return color, trail
    o, d, weight = o[cast], d[cast], weight[cast]
    t, index, outward, face = first_hit(world.shapes, o, d)
    inner_color = np.broadcast_to(np.asarray(world.background, float), o.shape).copy()
    inner_trail = _mixed(np.ones(len(o), np.uint64), index + 1)
    for k, material in enumerate(world.materials):
        mine = index == k
        if mine.any():
            inner_color[mine], more = _shaded(
                world, material, o[mine], d[mine], t[mine], outward[mine], level,
                weight[mine],
            )  # fmt: skip
            inner_trail[mine] = _mixed(_mixed(inner_trail[mine], face[mine]), more)
    color[cast], trail[cast] = inner_color, inner_trail
    return color, trail


def _shaded(
    world: _World,
    material: ij.Material,
    o: Vectors,
    d: Vectors,
    t: np.ndarray,
    outward: Vectors,
    level: int,
    weight: np.ndarray,
) -> tuple[Vectors, np.ndarray]:
    """Colors of the points of one material, and the trails behind them."""

    def part(name: str) -> float:
        value = getattr(material, name)
        return 0.0 if value is None or level >= world.depth else float(value)

    p = o + t[:, None] * d
    inside = _dot(outward, d) > 0
    n = np.where(inside[:, None], -outward, outward)
    light, trail = _lit(world, p, n, -d, material.exponent)
    reflect, transmit = part("reflect"), part("transmit")
    own = 1 - reflect - transmit
    color = own * light * np.asarray(material.color, float)
    back = np.full(len(p), reflect)
    if transmit:
        assert material.ior is not None
        ior = float(material.ior)
        sine = np.linalg.norm(np.cross(d, n), axis=1) * np.where(inside, ior, 1 / ior)
        total = sine >= 1
        cos_out = np.sqrt(np.where(total, 0, 1 - sine**2))
        cos_in = -_dot(n, d)
        before, behind = np.where(inside, ior, 1.0), np.where(inside, 1.0, ior)
        s = (before * cos_in - behind * cos_out) / (before * cos_in + behind * cos_out)
        q = (before * cos_out - behind * cos_in) / (before * cos_out + behind * cos_in)
        turned = (s**2 + q**2) / 2 if material.fresnel is not None else np.zeros(len(p))
        turned = np.where(total, 1.0, turned)
        along = d + cos_in[:, None] * n
        size = np.linalg.norm(along, axis=1, keepdims=True)
        tangent = along / np.where(size > 0, size, 1)
        bent = np.where(total, 0, sine)[:, None] * tangent - cos_out[:, None] * n
        on = transmit * (1 - turned)
        seen, behind_it = _color(world, p, bent, level + 1, weight * on)
        color = color + on[:, None] * seen
        trail = _mixed(_mixed(trail, behind_it), total)
        back = back + transmit * turned
    if np.any(back > 0):
        mirrored = d - 2 * _dot(n, d)[:, None] * n
        seen, before_it = _color(world, p, mirrored, level + 1, weight * back)
        color, trail = color + back[:, None] * seen, _mixed(trail, before_it)
    return color, trail


def _lit(
    world: _World, p: Vectors, n: Vectors, v: Vectors, exponent: Any
) -> tuple[Vectors, np.ndarray]:
    """What a white surface reflects of all lights, and which are hidden."""
    total, trail = np.zeros_like(p), np.zeros(len(p), np.uint64)
    for light in world.lights:
        intensity = np.asarray(light.intensity, float) * np.ones(3)
        if isinstance(light, ij.AmbientLight):
            total = total + intensity
            continue
        if isinstance(light, ij.PointLight):
            way = np.asarray(light.position, float) - p
            distance = np.linalg.norm(way, axis=1)
        else:
            way = np.broadcast_to(np.asarray(light.direction, float), p.shape)
            distance = np.full(len(p), np.inf)
        to_light = _unit(way)
        n_l = _dot(n, to_light)
        t, *_ = first_hit(world.shapes, p, to_light)
        shines = (n_l > 0) & ~(t < distance)
        part = np.where(shines, n_l, 0)
        if exponent is not None:
            r_v = _dot(2 * n_l[:, None] * n - to_light, v)
            shine = np.maximum(r_v, 0) ** float(exponent)
            part = part + np.where(shines & (r_v > 0), shine, 0)
        if isinstance(light, ij.PointLight) and light.falloff == "inverse_square":
            part = part / distance**2
        total = total + part[:, None] * intensity
        trail = _mixed(trail, shines)
    return total, trail


def _mixed(trail: np.ndarray, new: np.ndarray) -> np.ndarray:
    return trail * np.uint64(6364136223846793005) + new.astype(np.uint64) + np.uint64(1)


def _dot(v: Vectors, w: Vectors) -> np.ndarray:
    return np.einsum("nk,nk->n", v, w)


def _unit(v: Vectors) -> Vectors:
    return v / np.linalg.norm(v, axis=1, keepdims=True)
