"""Triangles of single shapes, no farther from their surfaces than is asked for.

All corners lie on the surface. A chord of an arc of radius r that spans the angle 2 a
is off it by r (1 - cos a) at most, a sphere's triangle by r less the distance of its
plane. Of a surface S(u, v) that is linear within a right triangle with the legs du, dv

    (|S_uu| du^2 + 2 |S_uv| du dv + |S_vv| dv^2) / 8

is a bound, with the largest derivatives there are: that of a torus and a heightfield.
It is reached at the middle of the long side.
"""

__all__ = ["surface_of"]

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from impostor_jax.io.mesh_sheet import sheet_of
from impostor_jax.io.triangles import (
    Corners,
    Triangles,
    check_count,
    compact,
    merged,
    woven,
)
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.primitives.torus import Torus
from impostor_jax.primitives.triangle import Triangle

LEAST_SIDES = 3
"""Of what is round, however far it may be off."""


def surface_of(shape: AbstractPrimitive, tolerance: float) -> Triangles:
    """Triangles of a shape that has an end and is no solid of others.

    Args:
        shape: A single one; or triangles, of which corners in one place become one.
        tolerance: Largest distance from its surface, in meters.

    Raises:
        ValueError: They would be too many.
    """
    return MADE_BY[type(shape)](shape, tolerance)


def _sides(radius: float, tolerance: float, sweep: float) -> int:
    """Chords of an arc."""
    half_angle = 2 * math.asin(math.sqrt(min(1.0, tolerance / (2 * radius))))
    return math.ceil(sweep / min(2 * half_angle, 2 * math.pi / LEAST_SIDES))


def _unit(vector: Any) -> Float[np.ndarray, "3"]:
    vector = np.asarray(vector, float)
    return vector / np.linalg.norm(vector)


def _across(axis: Float[np.ndarray, "3"], zero: Any) -> Float[np.ndarray, "3"]:
    """Direction of the angle 0; if none is given, the same about an axis and back."""
    if zero is None:
        zero = np.eye(3)[np.argmin(np.abs(axis))]
    zero = np.asarray(zero, float)
    return _unit(zero - axis * (axis @ zero))


def _of_cylinder(shape: Cylinder, tolerance: float) -> Triangles:
    axis = _unit(shape.axis)
    half = axis * float(shape.height) / 2
    center, radius = np.asarray(shape.center, float), float(shape.radius)
    return _tapered(shape, (center - half, center + half), (radius, radius), tolerance)


def _of_frustum(shape: Frustum, tolerance: float) -> Triangles:
    ends = np.asarray(shape.p1, float), np.asarray(shape.p2, float)
    radii = float(shape.radius1), float(shape.radius2)
    return _tapered(shape, ends, radii, tolerance)


def _tapered(
    shape: Cylinder | Frustum,
    ends: tuple[np.ndarray, np.ndarray],
    radii: tuple[float, float],
    tolerance: float,
) -> Triangles:
    """Wall between two discs, and what closes it."""
    axis = _unit(ends[1] - ends[0])
    x = _across(axis, shape.zero)
    start, sweep = 0.0, 2 * math.pi
    is_whole = shape.start_angle is None or shape.end_angle is None
    if shape.start_angle is not None and shape.end_angle is not None:
        start = float(shape.start_angle)
        sweep = (float(shape.end_angle) - start) % sweep
    count = _sides(max(radii), tolerance, sweep)
    check_count(4.0 * count, tolerance)
    turn = start + sweep * np.arange(count if is_whole else count + 1) / count
    # From the axis out, along the wall and back to the axis. A tip is on it.
    rim = [(r, k) for k, r in enumerate(radii) if r > 0]
    profile = np.array([(0.0, 0), *rim, (0.0, 1)])
    is_cap = np.diff(profile[:, 1]) == 0
    along = profile[:, 1, None] * (ends[1] - ends[0])
    shown = shape.caps | ~is_cap
    corners = _revolved(axis, x, profile[:, 0], ends[0] + along, turn)
    faces = [woven(corners.grid, is_whole, False)[shown].reshape(-1, 3)]
    if not is_whole and shape.cut_faces:
        last = corners.grid[:, -1]
        for k in range(1, len(profile) - 1):
            first = corners.grid[[0, k, k + 1], 0]
            faces += [first[None], last[[k + 1, k, 0]][None]]
    return compact(corners.points, np.concatenate(faces))


def _of_torus(shape: Torus, tolerance: float) -> Triangles:
    axis, center = _unit(shape.axis), np.asarray(shape.center, float)
    major, minor = float(shape.major_radius), float(shape.minor_radius)
    # |S_uu| and |S_vv| are at most these radii and |S_uv| the smaller one; each leg is
    # as long as makes its own term the same.
    radii = np.array([major + minor, minor])
    term = 8 * tolerance / (2 + 2 * math.sqrt(minor / (major + minor)))
    counts = np.maximum(np.ceil(2 * np.pi * np.sqrt(radii / term)), LEAST_SIDES)
    check_count(2 * counts.prod(), tolerance)
    turn, around = (2 * np.pi * np.arange(n) / n for n in counts.astype(int))
    level = center + minor * np.sin(around)[:, None] * axis
    out = major + minor * np.cos(around)
    corners = _revolved(axis, _across(axis, None), out, level, turn)
    faces = woven(corners.grid, True, True).reshape(-1, 3)
    return Triangles(corners.points, faces)


def _revolved(
    axis: Float[np.ndarray, "3"],
    x: Float[np.ndarray, "3"],
    radii: Float[np.ndarray, " k"],
    levels: Float[np.ndarray, "k 3"],
    turn: Float[np.ndarray, " n"],
) -> Corners:
    """A profile turned about an axis; on the axis all its points are one."""
    way = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * np.cross(axis, x)
    points = levels[:, None] + radii[:, None, None] * way
    index = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
    index = np.where(radii[:, None] > 0, index, index[:, :1])
    return Corners(points.reshape(-1, 3), index)


def _of_sphere(shape: Sphere, tolerance: float) -> Triangles:
    radius = float(shape.radius)
    # Where an icosahedron's face is thrown onto the sphere its middle grows most, so
    # that a part of it has the circumradius 0.764 / parts.
    parts = max(1, math.floor(0.764 * math.sqrt(radius / (2 * tolerance))))
    check_count(20.0 * parts**2, tolerance)
    while True:
        points, faces = _geodesic(parts)
        corners = points[faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normal, axis=1)
        nearest = np.min(np.sum(normal * corners[:, 0], axis=1) / length)
        if radius * (1 - nearest) <= tolerance:
            return Triangles(np.asarray(shape.center, float) + radius * points, faces)
        parts += 1


def _geodesic(parts: int) -> Triangles:
    """Icosahedron whose edges are cut in so many parts, thrown onto the unit sphere."""
    golden = (1 + math.sqrt(5)) / 2
    some = np.array(
        [(0, 1, golden), (0, 1, -golden), (0, -1, golden), (0, -1, -golden)]
    )
    points = np.concatenate([np.roll(some, k, axis=1) for k in range(3)])
    # Faces are the triples of corners that are neighbors, at a distance of 2.
    near = np.abs(np.linalg.norm(points[:, None] - points, axis=-1) - 2) < 1e-9
    index = np.arange(len(points))
    triples = [
        (i, j, k)
        for i in index
        for j in index[i + 1 :]
        for k in index[j + 1 :]
        if near[i, j] and near[j, k] and near[i, k]
    ]
    corners = points[np.array(triples)]
    turned = np.linalg.det(corners) < 0
    corners[turned] = corners[turned][:, ::-1]
    u, v = np.meshgrid(np.arange(parts + 1), np.arange(parts + 1), indexing="ij")
    inside = u + v <= parts
    number = np.full(u.shape, -1)
    number[inside] = np.arange(inside.sum())
    weight = np.stack([parts - u - v, u, v], axis=-1)[inside] / parts
    cells = np.concatenate(
        [
            np.stack([number[:-1, :-1], number[1:, :-1], number[:-1, 1:]], -1),
            np.stack([number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1),
        ]
    ).reshape(-1, 3)
    cells = cells[np.all(cells >= 0, axis=1)]
    spread = np.einsum("pk,fkx->fpx", weight, corners)
    spread /= np.linalg.norm(spread, axis=-1, keepdims=True)
    faces = cells + len(weight) * np.arange(len(corners))[:, None, None]
    return merged(spread.reshape(-1, 3), faces.reshape(-1, 3), 1e-9)


def _of_box(shape: Box, tolerance: float) -> Triangles:
    del tolerance
    signs = np.stack(np.meshgrid(*[(-1, 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    # The columns are taken as they are, as normals of the faces.
    back = np.linalg.inv(np.asarray(shape.rotation, float))
    half = signs * np.asarray(shape.size, float) / 2
    quads = np.array(
        [
            (0, 1, 3, 2),
            (4, 6, 7, 5),
            (0, 4, 5, 1),
            (2, 3, 7, 6),
            (0, 2, 6, 4),
            (1, 5, 7, 3),
        ]
    )
    faces = quads[:, [(0, 1, 2), (0, 2, 3)]].reshape(-1, 3)
    return Triangles(np.asarray(shape.center, float) + half @ back, faces)


def _of_triangles(shape: Triangle, tolerance: float) -> Triangles:
    del tolerance
    points = np.asarray(shape.vertices, float).reshape(-1, 3)
    return merged(points, np.arange(len(points)).reshape(-1, 3), 0.0)


MADE_BY: dict[type[AbstractPrimitive], Callable[[Any, float], Triangles]] = {
    Box: _of_box,
    Cylinder: _of_cylinder,
    Frustum: _of_frustum,
    Heightfield: sheet_of,
    Sphere: _of_sphere,
    Torus: _of_torus,
    Triangle: _of_triangles,
}
"""Of every primitive that has an end."""
