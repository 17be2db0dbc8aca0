"""What an image says along some rays, as rows that a fit compares with a body."""

__all__ = ["BLOCK", "Kind", "Rows"]

import enum

import equinox as eqx
from jaxtyping import Array, Float, Int

from impostor_jax.geometry.vec3 import Vec3

BLOCK = 1024
"""Rows that are summed at a time: 1 block takes 75 us, and 6 take 430."""


class Kind(enum.IntEnum):
    """What a row compares."""

    DEPTH = 0
    SQUARE = 1
    END = 2
    WALL = 3


class Rows(eqx.Module):
    """What the image says along some rays from the camera's center; one residual each.

    Attributes:
        direction: In the camera frame, with z = 1.
        kind: Of `Kind`.
        end: For a ray through an edge of the image of an end: -1 at the end
            `center - axis * height / 2`, 1 at the other; 0 for other rows.
        side: Where the ray meets that end's plane there: -1 where it enters the wall
            (an end that faces away), 1 where it leaves it.
        target: Depth that was read, in meters; for a square, what it tells of the
            squared half-chord; 0 for an edge.
        weight: Inverse of the standard deviation of what is compared; 0 for rows that
            only fill up.
        slack: Error that is forgiven, in the units of what is compared.
        nearest: For a square, the depth of the nearest approach from which it was
            measured.
        half: For a square, the half-chord there, along which its target follows the
            nearest approach.
        chord: Half-chord in meters: of a square, what its difference is divided by; of
            the others, below which the square root gives way to a straight line, so
            that a solver can cross the outline: sqrt(q) becomes
            q / (q^2 + chord^4)^(1/4).
    """

    direction: Vec3
    kind: Int[Array, "*batch"]
    end: Float[Array, "*batch"]
    side: Float[Array, "*batch"]
    target: Float[Array, "*batch"]
    weight: Float[Array, "*batch"]
    slack: Float[Array, "*batch"]
    nearest: Float[Array, "*batch"]
    half: Float[Array, "*batch"]
    chord: Float[Array, "*batch"]
