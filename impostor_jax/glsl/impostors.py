"""Which shaders draw a primitive, and what they are told of it.

`shaders/<name>.frag` defines how one ray meets the primitive,

    Surface intersect(vec3 o, vec3 d)    // or MISS; see rays.glsl

and `shaders/<name>.vert` the rectangle of the image on which this is tried,

    vec4 billboard(vec2 corner)          // clip space; corner is (-1 or 1, -1 or 1)

of which a primitive without a `.vert` takes the whole image or another's. Both read the
fields listed below, which are the primitive's own or computed from them; numbers of
which one has more than another come in a texture, `sample_at(k)` in the fragment
shader. All else is common to the primitives.

A solid made of others is drawn by a shader of its own (`solid_program`), which asks its
shapes where a ray is in them: `shaders/<name>_stretches.glsl` tells it.
"""

__all__ = ["IMPOSTORS", "impostor_of"]

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.geometry.vec3 import Vec3, unit
from impostor_jax.glsl.impostor import Ball, Impostor, own_values
from impostor_jax.glsl.solid_impostor import solid_impostor
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.heightfield_grid import relief
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.sector import sector
from impostor_jax.primitives.solid import Solid
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.primitives.torus import Torus
from impostor_jax.primitives.triangle import Triangle


def impostor_of(primitive: AbstractPrimitive) -> Impostor:
    """How a primitive is drawn: a cylinder that is not whole as a frustum."""
    if isinstance(primitive, Solid):
        return solid_impostor(primitive, tuple(map(impostor_of, primitive.shapes)))
    if isinstance(primitive, Cylinder) and not primitive.is_whole:
        return _OPEN_CYLINDER
    return IMPOSTORS[type(primitive)]


def _plane_ball(planes: Plane) -> Ball:
    # Around the point nearest to the camera, whichever point the plane was given by.
    normal = np.asarray(unit(jnp.asarray(planes.unit_normal)))
    height = np.sum(normal * planes.point, axis=-1)
    return normal * height[:, None], np.full(height.shape, np.inf)


def _torus_values(tori: Torus) -> dict[str, Any]:
    """Its own, and those of the cylinder around it."""
    return {
        **own_values(tori),
        "radius": tori.major_radius + tori.minor_radius,
        "height": 2 * tori.minor_radius,
    }


def _triangle_values(triangles: Triangle) -> dict[str, Any]:
    # A column of a matrix is what a shader takes one of by its number.
    return {"corners": np.swapaxes(np.asarray(triangles.vertices), -1, -2)}


def _frustum_values(frusta: Frustum) -> dict[str, Any]:
    # Of NumPy's arrays, which it is kept as.
    axis = jax.tree.map(jnp.asarray, frusta).axis
    return {**vars(frusta), "axis": axis, **_openings(frusta, axis)}


def _open_cylinder_values(cylinders: Cylinder) -> dict[str, Any]:
    """Those of the frustum of equal radii."""
    axis = unit(jnp.asarray(cylinders.axis))
    reach = axis * cylinders.height[:, None] / 2
    return {
        "p1": cylinders.center - reach,
        "p2": cylinders.center + reach,
        "radius1": cylinders.radius,
        "radius2": cylinders.radius,
        "axis": axis,
        **_openings(cylinders, axis),
    }


def _openings(body: Frustum | Cylinder, axis: Float[Array, "n 3"]) -> dict[str, Any]:
    """The faces of a sector, zero where the turn is whole, and what is there."""
    angles = jax.tree.map(jnp.asarray, (body.start_angle, body.end_angle, body.zero))
    cut = sector(Vec3.from_array(axis), *angles)
    nothing = jnp.zeros_like(axis)
    flags = {
        "is_sector": cut is not None,
        "caps": body.caps,
        "cut_faces": body.cut_faces,
    }
    return {
        "start": nothing if cut is None else cut.start.stack(),
        "end": nothing if cut is None else cut.end.stack(),
        **{name: np.full(len(axis), float(is_so)) for name, is_so in flags.items()},
    }


def _heightfield_values(grounds: Heightfield) -> dict[str, Any]:
    """The box that holds the surface, and how its grid is read."""
    low, high = _relief(grounds)
    (x0, x1), (z0, z1) = np.moveaxis(np.asarray(grounds.extent), 0, -1)
    center = np.stack([(x0 + x1) / 2, (low + high) / 2, (z0 + z1) / 2], axis=-1)
    rotation = np.broadcast_to(np.eye(3), (len(low), 3, 3))
    if grounds.world_from_field is not None:
        pose = jax.tree.map(np.asarray, grounds.world_from_field)
        rotation = pose.rotation
        center = np.einsum("nij,nj->ni", rotation, center) + pose.translation
    return {
        "center": center,
        "rotation": rotation,
        "size": np.stack([x1 - x0, high - low, z1 - z0], axis=-1),
        "patches": np.full((len(low), 2), np.asarray(grounds.height).shape[1:]) - 1,
        "is_bicubic": np.full(len(low), float(grounds.interpolation == "bicubic")),
    }


def _heightfield_samples(grounds: Heightfield) -> Float[np.ndarray, "n k"]:
    """Heights above the center of the box, row by row."""
    low, high = _relief(grounds)
    heights = np.asarray(grounds.height)
    return heights.reshape(len(low), -1) - (low + high)[:, None] / 2


def _relief(
    grounds: Heightfield,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Lowest and highest control points, between which the surfaces lie."""
    low, high = relief(jnp.asarray(grounds.height), grounds.interpolation)
    return np.asarray(low), np.asarray(high)


_FRUSTUM = Impostor(
    "frustum",
    {
        **dict.fromkeys(("p1", "p2", "axis", "start", "end"), 3),
        **dict.fromkeys(("radius1", "radius2", "is_sector", "caps", "cut_faces"), 1),
    },
    _frustum_values,
)

_OPEN_CYLINDER = dataclasses.replace(_FRUSTUM, values=_open_cylinder_values)

IMPOSTORS: dict[type[AbstractPrimitive], Impostor] = {
    Box: Impostor("box", {"center": 3, "rotation": 9, "size": 3}),
    Cylinder: Impostor(
        "cylinder",
        {"center": 3, "axis": 3, "radius": 1, "height": 1},
    ),
    Frustum: _FRUSTUM,
    Heightfield: Impostor(
        "heightfield",
        {"center": 3, "rotation": 9, "size": 3, "patches": 2, "is_bicubic": 1},
        _heightfield_values,
        _heightfield_samples,
        billboard="box",
    ),
    Plane: Impostor("plane", {"point": 3, "unit_normal": 3}, ball=_plane_ball),
    Sphere: Impostor("sphere", {"center": 3, "radius": 1}),
    Torus: Impostor(
        "torus",
        {
            **dict.fromkeys(("center", "axis"), 3),
            **dict.fromkeys(("major_radius", "minor_radius", "radius", "height"), 1),
        },
        _torus_values,
        billboard="cylinder",
    ),
    Triangle: Impostor("triangle", {"corners": 9}, values=_triangle_values),
}
