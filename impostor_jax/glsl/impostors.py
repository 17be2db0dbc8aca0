"""Which shaders draw a primitive, and what they are told of it.

`shaders/<name>.frag` defines how one ray meets the primitive,

    Surface intersect(vec3 o, vec3 d)    // or MISS; see rays.glsl

and `shaders/<name>.vert` the rectangle of the image on which this is tried,

    vec4 billboard(vec2 corner)          // clip space; corner is (-1 or 1, -1 or 1)

of which a primitive without a `.vert` takes the whole image. Both read the fields
listed below under the primitive's own names. All else is common to the primitives.
"""

__all__ = ["IMPOSTORS", "Ball", "Impostor"]

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.sphere import Sphere

Ball = tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]
"""Centers and radii, in meters; `+inf` around a point of something without end."""


@dataclasses.dataclass(frozen=True)
class Impostor:
    """How a primitive is drawn.

    Attributes:
        name: Stem of its shaders' file names.
        fields: Fields of the primitive that the shaders read, each with its number of
            components: 1 to 4, or 9 for a matrix.
        ball: Balls that hold the primitives of a batch (n,), from their fields.
    """

    name: str
    fields: dict[str, int]
    ball: Callable[[Any], Ball]


def _cylinder_ball(cylinders: Cylinder) -> Ball:
    reach = np.hypot(cylinders.radius, cylinders.height / 2)
    return np.asarray(cylinders.center), np.asarray(reach)


def _sphere_ball(spheres: Sphere) -> Ball:
    return np.asarray(spheres.center), np.asarray(spheres.radius)


IMPOSTORS: dict[type[AbstractPrimitive], Impostor] = {
    Cylinder: Impostor(
        "cylinder", {"center": 3, "axis": 3, "radius": 1, "height": 1}, _cylinder_ball
    ),
    Sphere: Impostor("sphere", {"center": 3, "radius": 1}, _sphere_ball),
}
