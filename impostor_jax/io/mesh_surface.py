"""Triangles of single shapes, no farther from their surfaces than is asked for.

All corners lie on the surface. A chord of an arc of radius r that spans the angle 2 a
is off it by r (1 - cos a) at most, a sphere's triangle by r less the distance of its
plane. Of a surface S(u, v) that is linear within a right triangle with the legs du, dv

    (|S_uu| du^2 + 2 |S_uv| du dv + |S_vv| dv^2) / 8

is a bound, with the largest derivatives there are: that of a torus and a heightfield.
It is reached at the middle of the long side.
"""

__all__ = ["Triangles", "ground_of", "joined", "moved", "surface_of"]

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.heightfield_grid import all_control_points
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.primitives.torus import Torus
from impostor_jax.primitives.triangle import Triangle

MOST_TRIANGLES = 10**7
"""Of a shape; more would take gigabytes."""

LEAST_SIDES = 3
"""Of what is round, however far it may be off."""

Points = Float[np.ndarray, "n 3"]
Faces = Int[np.ndarray, "m 3"]


class Triangles(NamedTuple):
    """A mesh.

    Attributes:
        vertices: In meters.
        faces: Corners of each triangle, counterclockwise as seen from outside.
    """

    vertices: Points
    faces: Faces


def surface_of(shape: AbstractPrimitive, tolerance: float) -> Triangles:
    """Triangles of a shape that has an end and is no solid of others.

    Args:
        shape: A single one; or triangles, of which corners in one place become one.
        tolerance: Largest distance from its surface, in meters.

    Raises:
        ValueError: They would be too many.
    """
    return MADE_BY[type(shape)](shape, tolerance)


def joined(meshes: Sequence[Triangles]) -> Triangles:
    """Several meshes as one, in order."""
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Triangles(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate(
            [mesh.faces + k for mesh, k in zip(meshes, first[:-1], strict=True)]
        ),
    )


def _sides(radius: float, tolerance: float, sweep: float) -> int:
    """Chords of an arc."""
    half_angle = 2 * math.asin(math.sqrt(min(1.0, tolerance / (2 * radius))))
    return math.ceil(sweep / min(2 * half_angle, 2 * math.pi / LEAST_SIDES))


def _check_count(count: float, tolerance: float) -> None:
    if count > MOST_TRIANGLES:
        raise ValueError(
            f"tolerance must be larger, in meters, got {tolerance:.3g}: a shape would "
            f"have {count:.3g} triangles, and {MOST_TRIANGLES} are the most"
        )


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
    _check_count(4.0 * count, tolerance)
    turn = start + sweep * np.arange(count if is_whole else count + 1) / count
    # From the axis out, along the wall and back to the axis. A tip is on it.
    rim = [(r, k) for k, r in enumerate(radii) if r > 0]
    profile = np.array([(0.0, 0), *rim, (0.0, 1)])
    is_cap = np.diff(profile[:, 1]) == 0
    along = profile[:, 1, None] * (ends[1] - ends[0])
    shown = shape.caps | ~is_cap
    corners = _revolved(axis, x, profile[:, 0], ends[0] + along, turn)
    faces = [_woven(corners.grid, is_whole, False)[shown].reshape(-1, 3)]
    if not is_whole and shape.cut_faces:
        last = corners.grid[:, -1]
        for k in range(1, len(profile) - 1):
            first = corners.grid[[0, k, k + 1], 0]
            faces += [first[None], last[[k + 1, k, 0]][None]]
    return _compact(corners.points, np.concatenate(faces))


def _of_torus(shape: Torus, tolerance: float) -> Triangles:
    axis, center = _unit(shape.axis), np.asarray(shape.center, float)
    major, minor = float(shape.major_radius), float(shape.minor_radius)
    # |S_uu| and |S_vv| are at most these radii and |S_uv| the smaller one; each leg is
    # as long as makes its own term the same.
    radii = np.array([major + minor, minor])
    term = 8 * tolerance / (2 + 2 * math.sqrt(minor / (major + minor)))
    counts = np.maximum(np.ceil(2 * np.pi * np.sqrt(radii / term)), LEAST_SIDES)
    _check_count(2 * counts.prod(), tolerance)
    turn, around = (2 * np.pi * np.arange(n) / n for n in counts.astype(int))
    level = center + minor * np.sin(around)[:, None] * axis
    out = major + minor * np.cos(around)
    corners = _revolved(axis, _across(axis, None), out, level, turn)
    faces = _woven(corners.grid, True, True).reshape(-1, 3)
    return Triangles(corners.points, faces)


class _Corners(NamedTuple):
    """Points of a surface of revolution, and which one is where, (profile, turn)."""

    points: Points
    grid: Int[np.ndarray, "k n"]


def _revolved(
    axis: Float[np.ndarray, "3"],
    x: Float[np.ndarray, "3"],
    radii: Float[np.ndarray, " k"],
    levels: Float[np.ndarray, "k 3"],
    turn: Float[np.ndarray, " n"],
) -> _Corners:
    """A profile turned about an axis; on the axis all its points are one."""
    way = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * np.cross(axis, x)
    points = levels[:, None] + radii[:, None, None] * way
    index = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
    index = np.where(radii[:, None] > 0, index, index[:, :1])
    return _Corners(points.reshape(-1, 3), index)


def _woven(
    index: Int[np.ndarray, "k n"], closes_turn: bool, closes_profile: bool
) -> Int[np.ndarray, "rows cols 2 3"]:
    """Two triangles of each cell of a grid of corners; at a tip one has no area."""
    if closes_turn:
        index = np.concatenate([index, index[:, :1]], axis=1)
    if closes_profile:
        index = np.concatenate([index, index[:1]])
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    return np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2)


def _compact(points: Points, faces: Faces) -> Triangles:
    """Without triangles of fewer than three corners, and without points of none."""
    spans = np.all(faces != np.roll(faces, 1, axis=1), axis=1)
    used, faces = np.unique(faces[spans], return_inverse=True)
    return Triangles(points[used], faces.reshape(-1, 3))


def _of_sphere(shape: Sphere, tolerance: float) -> Triangles:
    radius = float(shape.radius)
    # Where an icosahedron's face is thrown onto the sphere its middle grows most, so
    # that a part of it has the circumradius 0.764 / parts.
    parts = max(1, math.floor(0.764 * math.sqrt(radius / (2 * tolerance))))
    _check_count(20.0 * parts**2, tolerance)
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
    return _merged(spread.reshape(-1, 3), faces.reshape(-1, 3), 1e-9)


def _merged(points: Points, faces: Faces, width: float) -> Triangles:
    """With one point for all that are in one place, to a width; 0 is exactly."""
    places = np.round(points / width) if width else points
    # 0 and -0 are one place.
    _, kept, number = np.unique(
        places + 0.0, axis=0, return_index=True, return_inverse=True
    )
    return Triangles(points[kept], number.reshape(-1)[faces])


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
    return _merged(points, np.arange(len(points)).reshape(-1, 3), 0.0)


def _of_heightfield(shape: Heightfield, tolerance: float) -> Triangles:
    points, index = _sheet_of(shape, tolerance)
    points = moved(points, shape.world_from_field)
    return Triangles(points, _woven(index, False, False).reshape(-1, 3))


def moved(points: Points, transform: RigidTransform | None) -> Points:
    """Points in another frame, in double precision."""
    if transform is None:
        return points
    rotation = np.asarray(transform.rotation, float)
    return points @ rotation.T + np.asarray(transform.translation, float)


def ground_of(
    field: Heightfield, tolerance: float, box: Float[np.ndarray, "8 3"]
) -> Triangles:
    """The ground below a heightfield, closed by sides, and a bottom below a box.

    Args:
        field: A single one.
        tolerance: Largest distance from its surface, in meters.
        box: Corners of what it has to reach below.
    """
    points, index = _sheet_of(field, tolerance)
    pose = field.world_from_field
    own = moved(box, None if pose is None else pose.inverse())
    lowest = min(own[:, 1].min(), points[:, 1].min())
    bottom = lowest - (own[:, 1].max() - lowest)
    # Around the border, the way of the triangles there.
    border = np.concatenate(
        [index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]]
    )
    below = points[border]
    below[:, 1] = bottom
    middle = below.mean(axis=0, keepdims=True)
    first = len(points) + np.arange(len(border))
    a, b = border, np.roll(border, -1)
    c, d = first, np.roll(first, -1)
    center = np.full_like(c, len(points) + len(border))
    around = [np.stack(three, -1) for three in ((b, a, c), (b, c, d), (d, c, center))]
    faces = np.concatenate([_woven(index, False, False).reshape(-1, 3), *around])
    return Triangles(moved(np.concatenate([points, below, middle]), pose), faces)


def _sheet_of(field: Heightfield, tolerance: float) -> _Corners:
    """Points of a heightfield in its own frame, and which one is where, (x, z)."""
    (x0, x1), (z0, z1) = np.asarray(field.extent, float)
    if callable(field.height):
        step = _step(field, tolerance)
        counts = [max(1.0, np.ceil(length / step)) for length in (x1 - x0, z1 - z0)]
    else:
        points = np.asarray(all_control_points(field.height, field.interpolation))
        bend = _bend(points.astype(float))
        parts = max(1.0, np.ceil(np.sqrt(bend / (8 * tolerance))))
        counts = [parts * n for n in points.shape[2:]]
    _check_count(2 * counts[0] * counts[1], tolerance)
    x, z = (
        np.linspace(low, high, int(count) + 1)
        for low, high, count in zip((x0, z0), (x1, z1), counts, strict=True)
    )
    x, z = np.meshgrid(x, z, indexing="ij")
    height, *_ = field.surface(*(jnp.asarray(v, field.dtype) for v in (x, z)))
    points = np.stack([x, np.asarray(height, float), z], axis=-1)
    return _Corners(points.reshape(-1, 3), np.arange(x.size).reshape(x.shape))


def _step(field: Heightfield, tolerance: float) -> float:
    """Length of a cell's sides: what bounds of slope or curvature allow.

    By the slope alone a height is off by less than it times the circumradius.
    """
    assert field.lipschitz is not None
    slope = float(field.lipschitz)
    steps = [math.sqrt(2) * tolerance / slope if slope else math.inf]
    if field.curvature is not None:
        bend = float(field.curvature)
        steps.append(2 * math.sqrt(tolerance / bend) if bend else math.inf)
    return max(steps)


def _bend(points: Float[np.ndarray, "k k rows cols"]) -> float:
    """Bound of |h_uu| + 2 |h_uv| + |h_vv| of patches, by their control points."""
    degree = points.shape[0] - 1

    def largest(values: np.ndarray) -> float:
        return np.abs(values).max() if values.size else 0.0

    mixed = degree**2 * largest(np.diff(np.diff(points, axis=0), axis=1))
    along = [largest(np.diff(points, n=2, axis=axis)) for axis in (0, 1)]
    return 2 * mixed + degree * (degree - 1) * sum(along)


MADE_BY: dict[type[AbstractPrimitive], Callable[[Any, float], Triangles]] = {
    Box: _of_box,
    Cylinder: _of_cylinder,
    Frustum: _of_frustum,
    Heightfield: _of_heightfield,
    Sphere: _of_sphere,
    Torus: _of_torus,
    Triangle: _of_triangles,
}
"""Of every primitive that has an end."""
