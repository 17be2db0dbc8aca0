"""The sizes of a dataset's cylinders: few, so that each is an object with a mesh.

Readers of BOP datasets know objects by their number and their mesh. A mesh is a prism
around the axis z, in millimeters, as that format has it.
"""

__all__ = ["MAX_OBJECTS", "Item", "draw_catalogue", "mesh_ply", "models_info"]

import dataclasses
import math
from typing import Any

import numpy as np

from data_synth.distribution import Distribution
from impostor_jax.arguments import whole_number

MAX_OBJECTS = 50
"""Most sizes of a dataset."""

SIDES = 64
"""Of a mesh's prism: it leaves the circle by 0.12 % of the radius."""


@dataclasses.dataclass(frozen=True)
class Item:
    """Size of an object.

    Attributes:
        number: Its `obj_id`, from 1.
        radius: In meters.
        height: In meters.
    """

    number: int
    radius: float
    height: float


def draw_catalogue(
    count: int, radius: Distribution, aspect: Distribution, rng: np.random.Generator
) -> tuple[Item, ...]:
    """Draw the sizes of a dataset, rounded to 0.1 mm as a maker would.

    Args:
        count: How many, at most `MAX_OBJECTS`.
        radius: In meters.
        aspect: Height over radius.
        rng: Source of all that is drawn.
    """
    whole_number("count", count, 0, MAX_OBJECTS)
    items = []
    for number in range(1, count + 1):
        wide = radius.draw(rng)
        tall = wide * aspect.draw(rng)
        items.append(Item(number, round(wide, 4), round(tall, 4)))
    return tuple(items)


def models_info(catalogue: tuple[Item, ...]) -> dict[str, dict[str, Any]]:
    """The record `models_info.json`: sizes in millimeters, and symmetries."""
    # Half a turn about x, which brings one end to the other's place.
    flip = [1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1]
    records = {}
    for item in catalogue:
        wide, tall = 2e3 * item.radius, 1e3 * item.height
        sizes = {"x": wide, "y": wide, "z": tall}
        records[str(item.number)] = {
            "diameter": math.hypot(wide, tall),
            **{f"min_{axis}": -size / 2 for axis, size in sizes.items()},
            **{f"size_{axis}": size for axis, size in sizes.items()},
            "symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}],
            "symmetries_discrete": [flip],
        }
    return records


def mesh_ply(item: Item) -> str:
    """Mesh of an object as an ASCII PLY file, in millimeters, faces outwards."""
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    ring = 1e3 * item.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    half = 500 * item.height
    points = [(0.0, 0.0, -half), (0.0, 0.0, half)]
    points += [(x, y, z) for z in (-half, half) for x, y in ring]
    faces = []
    for k in range(SIDES):
        low, next_low = 2 + k, 2 + (k + 1) % SIDES
        high, next_high = low + SIDES, next_low + SIDES
        faces += [(0, next_low, low), (1, high, next_high)]
        faces += [(low, next_low, next_high), (low, next_high, high)]
    header = [
        "ply",
        "format ascii 1.0",
        f"element vertex {len(points)}",
        *(f"property float {name}" for name in "xyz"),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    lines = [" ".join(f"{value:.6f}" for value in point) for point in points]
    lines += [f"3 {a} {b} {c}" for a, b, c in faces]
    return "\n".join([*header, *lines]) + "\n"
