"""Tubes: cans with a through bore, whose ends are rings.

A tube is no class of its own but a solid: its outer cylinder less that of the bore,
which has the same axis and the same ends. Flush faces are one to a `Solid`, so the bore
is open.
"""

__all__ = ["Tube", "as_tube", "is_tube", "tube"]

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.arguments import is_concrete, is_exact
from impostor_jax.geometry.frames import Points
from impostor_jax.geometry.vec3 import unit
from impostor_jax.numerics import Numbers, product
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.solid import Solid, difference

CUT = "difference", (0, 1)
"""How a tube is made of its two cylinders."""


class Tube(NamedTuple):
    """What a tube is given by, in the world frame; any of it may be a batch.

    Attributes:
        center: Midpoint of the axis between the ends, in meters.
        axis: Unit vector.
        outer_radius: In meters.
        inner_radius: Of the bore, in meters.
        height: Distance of the ends, in meters.
    """

    center: Points
    axis: Float[Array, "*batch 3"]
    outer_radius: Numbers
    inner_radius: Numbers
    height: Numbers

    @property
    def solid(self) -> Solid:
        """What is rendered; the values are not checked."""
        batch, dtype = self.center.shape[:-1], self.outer_radius.dtype
        zeros = jnp.zeros((*batch, 3), dtype)
        # What lies far off keeps its digits as a place of what lies near.
        center, place = self.center, zeros
        if isinstance(center, np.ndarray):
            center, place = zeros, center
        outer, inner = (
            _cylinder(center, self.axis, radius, self.height)
            for radius in (self.outer_radius, self.inner_radius)
        )
        return Solid(
            shapes=(outer, inner),
            expression=CUT,
            rotation=jnp.broadcast_to(jnp.eye(3, dtype=dtype), (*batch, 3, 3)),
            translation=place,
        )


def _cylinder(
    center: Float[Array, "*batch 3"],
    axis: Float[Array, "*batch 3"],
    radius: Numbers,
    height: Numbers,
) -> Cylinder:
    return eqx.tree_at(
        lambda c: (c.center, c.axis, c.radius, c.height),
        Cylinder((0, 0, 0), (0, 0, 1), 1, 1),
        (center, axis, radius, height),
    )


def tube(
    center: Any, axis: Any, outer_radius: Any, inner_radius: Any, height: Any
) -> Solid:
    """A tube with flat ends and a bore all along its axis, as a solid.

        pipe = ij.tube((0, 0, 1), (0, 0.6, 0.8), 0.04, 0.035, 0.12)

    Args:
        center: Midpoint of the axis between the ends, in meters.
        axis: Direction of the axis; need not be normalized.
        outer_radius: In meters.
        inner_radius: Of the bore, in meters; less than the outer one.
        height: Distance of the ends, in meters.

    Raises:
        ValueError: As in `Cylinder`, or the bore is not narrower than the tube.
    """
    outer = Cylinder(center, axis, outer_radius, height)
    inner = Cylinder(center, axis, inner_radius, height)
    radii = outer.radius, inner.radius
    if is_concrete(radii) and not np.all(np.asarray(radii[1]) < np.asarray(radii[0])):
        raise ValueError(
            f"inner_radius must be less than outer_radius, got {inner_radius} and "
            f"{outer_radius}; radii are in meters"
        )
    return difference(outer, inner)


def is_tube(shape: AbstractPrimitive) -> bool:
    """Whether a shape is made as `tube` makes it, as far as its values are known."""
    if not isinstance(shape, Solid) or shape.expression != CUT:
        return False
    parts = [part for part in shape.shapes if isinstance(part, Cylinder)]
    if len(parts) < 2 or not all(part.is_whole for part in parts):
        return False
    placed = [(part.center, part.axis, part.height) for part in parts]
    return not is_concrete(placed) or all(
        np.array_equal(one, other, equal_nan=True)
        for one, other in zip(*placed, strict=True)
    )


def as_tube(solid: AbstractPrimitive) -> Tube:
    """What a tube is given by, in the world frame.

    Args:
        solid: As `tube` made it, moved or not.

    Raises:
        ValueError: It is no tube.
    """
    if not isinstance(solid, Solid) or not is_tube(solid):
        raise ValueError(
            "solid must be a tube, as ij.tube makes it, got "
            f"{type(solid).__name__.lower()}"
        )
    outer, inner = solid.shapes
    assert isinstance(outer, Cylinder)
    assert isinstance(inner, Cylinder)

    def turned(vector: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
        return product(solid.rotation, vector[..., None])[..., 0]

    center = turned(jnp.asarray(outer.center))
    if is_exact(solid.translation):
        center = np.asarray(center, np.float64)
    return Tube(
        center=center + solid.translation,
        axis=turned(unit(outer.axis)),
        outer_radius=outer.radius,
        inner_radius=inner.radius,
        height=outer.height,
    )
