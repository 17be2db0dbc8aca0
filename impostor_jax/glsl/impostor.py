"""What a shader is told of the primitives that it draws."""

__all__ = ["Ball", "Impostor", "Leaf", "Structure", "hull_ball", "own_values"]

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from impostor_jax.geometry.vec3 import unit
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.solid import Expression

Ball = tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]
"""Centers and radii, in meters; `+inf` around a point of something without end."""


def hull_ball(primitives: AbstractPrimitive) -> Ball:
    """Balls around the hulls of a batch (n,)."""
    hull = jax.tree.map(jnp.asarray, primitives).hull
    assert hull is not None
    center, radius = hull.ball()
    return np.asarray(center), np.asarray(radius)


def own_values(primitives: AbstractPrimitive) -> dict[str, Any]:
    """Fields of primitives by name, directions of unit length."""
    return {
        name: unit(jnp.asarray(value)) if name in ("axis", "unit_normal") else value
        for name, value in vars(primitives).items()
    }


@dataclasses.dataclass(frozen=True, eq=False)
class Impostor:
    """How a primitive is drawn.

    Attributes:
        name: Stem of its shaders' file names; of a solid, its own.
        fields: What the shaders read, each with its number of components: 1 to 4, or 9
            for a matrix.
        values: The fields' values of a batch (n,) by their names; those of the
            primitive itself, directions of unit length, if not given.
        samples: Numbers of each primitive of a batch (n,) that come in a texture.
        numbers: Others, four together, that come in a second one.
        billboard: Stem of the rectangle's file name, where it is not the primitive's.
        ball: Balls that hold the primitives of a batch (n,); around their hulls, if not
            given.
        structure: How a solid is made of others; None of any other primitive.
    """

    name: str
    fields: dict[str, int]
    values: Callable[[Any], dict[str, Any]] = own_values
    samples: Callable[[Any], Float[np.ndarray, "n k"]] | None = None
    numbers: Callable[[Any], Float[np.ndarray, "n k 4"]] | None = None
    billboard: str = ""
    ball: Callable[[Any], Ball] = hull_ball
    structure: "Structure | None" = None

    @property
    def counters(self) -> tuple[str, ...]:
        """Where an instance's numbers begin in the textures."""
        told = {"first_sample": self.samples, "first_number": self.numbers}
        return tuple(name for name, given in told.items() if given)

    @property
    def texels(self) -> int:
        """How many times four numbers fields and counters are."""
        return -(-(sum(self.fields.values()) + len(self.counters)) // 4)

    def columns(self, primitives: AbstractPrimitive) -> Float[np.ndarray, "n k"]:
        """Fields of each primitive of a batch (n,), side by side."""
        values, (many,) = self.values(primitives), primitives.batch_shape
        parts = [
            np.asarray(values[name]).reshape(many, count)
            for name, count in self.fields.items()
        ]
        return np.concatenate(parts, axis=-1)


@dataclasses.dataclass(frozen=True)
class Leaf:
    """A shape that solids are made of.

    Attributes:
        impostor: How it would be drawn.
        num_parts: Of its surface.
        num_stretches: Of a ray in it at most, 1 or 2.
    """

    impostor: Impostor
    num_parts: int
    num_stretches: int


@dataclasses.dataclass(frozen=True)
class Structure:
    """What solids that one program draws have in common.

    Attributes:
        expression: How they are made.
        leaves: Of what.
    """

    expression: Expression
    leaves: tuple[Leaf, ...]

    @property
    def impostors(self) -> dict[str, Impostor]:
        """Those of the leaves by name, each once."""
        return {leaf.impostor.name: leaf.impostor for leaf in self.leaves}

    @property
    def first_numbers(self) -> tuple[int, ...]:
        """Of each leaf, its first texel among those of the solid."""
        counts = np.cumsum([0, *(leaf.impostor.texels for leaf in self.leaves)])
        return tuple(int(count) for count in counts[:-1])

    @property
    def first_parts(self) -> tuple[int, ...]:
        """Of each leaf, the number of its first part."""
        counts = np.cumsum([0, *(leaf.num_parts for leaf in self.leaves)])
        return tuple(int(count) for count in counts[:-1])
