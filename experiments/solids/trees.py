"""Random solids made of up to eight shapes, with faces that lie flush and without."""

__all__ = ["Drawn", "drawn", "jax_solid", "random_rotation", "random_tree"]

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.oracle.solid import Shape, Tree
from impostor_jax.primitives import PRIMITIVES
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.solid import Solid, difference, intersection, union

KINDS = ("cylinder", "sphere", "box", "frustum", "cone", "sector", "torus", "plane")
OPERATIONS = {"union": union, "intersection": intersection, "difference": difference}


@dataclasses.dataclass(frozen=True)
class Drawn:
    """A solid as the oracle takes it; it is about two lengths large, around 0."""

    tree: Tree
    shapes: tuple[Shape, ...]


def random_tree(rng: np.random.Generator, count: int) -> Tree:
    """An expression of so many shapes."""

    def split(numbers: Sequence[int]) -> Tree:
        if len(numbers) == 1:
            return numbers[0]
        parts = int(rng.integers(2, min(3, len(numbers)) + 1))
        cuts = np.sort(rng.choice(np.arange(1, len(numbers)), parts - 1, replace=False))
        terms = tuple(
            split([int(k) for k in part]) for part in np.split(np.array(numbers), cuts)
        )
        # What is left of many intersections is often nothing.
        name = rng.choice(["union", "difference", "intersection"], p=[0.45, 0.4, 0.15])
        return str(name), terms

    return split(range(count))


def drawn(rng: np.random.Generator, tree: Tree, kinds: Sequence[str]) -> Drawn:
    """Shapes of some kinds: on a grid of eighths, so that faces lie flush; or not.

    Of three solids one has the grid's axes, one is turned, so that rounding parts the
    faces, and one has shapes anywhere.
    """
    way = rng.integers(3)
    turn = np.eye(3) if way == 0 else random_rotation(rng)
    shapes = []
    for kind in kinds:
        own = turn if way < 2 else random_rotation(rng)
        # All along one axis in half of the cases, as on a lathe.
        axis = 2 if rng.random() < 0.6 else int(rng.integers(3))
        eighths = np.zeros(3) if rng.random() < 0.5 else rng.integers(-3, 4, 3) / 8
        sizes = rng.integers(1, 7, 3) / 8
        if way == 2:
            eighths, sizes = rng.uniform(-0.4, 0.4, 3), rng.uniform(0.1, 0.8, 3)
        shapes.append(_shape(kind, own @ eighths, own, axis, sizes, rng))
    return Drawn(tree, tuple(shapes))


def jax_solid(solid: Drawn) -> Solid:
    """The same as the package has it."""

    def built(tree: Tree) -> AbstractPrimitive:
        if isinstance(tree, int):
            shape = solid.shapes[tree]
            return PRIMITIVES[shape.kind](**shape.values)
        name, terms = tree
        return OPERATIONS[name](*map(built, terms))

    found = built(solid.tree)
    return found if isinstance(found, Solid) else union(found)


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """A rotation, each as likely as any other."""
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return turn * np.sign(np.linalg.det(turn))


def _shape(
    kind: str,
    center: np.ndarray,
    turn: np.ndarray,
    axis: int,
    sizes: np.ndarray,
    rng: np.random.Generator,
) -> Shape:
    a, b = turn[:, axis], turn[:, (axis + 1) % 3]
    r, s, h = (float(size) for size in sizes)
    if kind == "cylinder":
        values: dict[str, Any] = {"center": center, "axis": a, "radius": r}
        return Shape(kind, values | {"height": 2 * h})
    if kind == "sphere":
        return Shape(kind, {"center": center, "radius": r})
    if kind == "box":
        size = 2 * np.array([r, s, h])
        return Shape(kind, {"center": center, "rotation": turn, "size": size})
    if kind == "plane":
        return Shape(kind, {"point": center, "normal": a * rng.choice([-1, 1])})
    if kind == "torus":
        major = r + 0.125
        values = {"center": center, "axis": a, "major_radius": major}
        return Shape(kind, values | {"minor_radius": major * rng.uniform(0.2, 0.8)})
    values = {"p1": center - h * a, "p2": center + h * a, "radius1": r, "radius2": s}
    if kind == "cone":
        values["radius2"] = 0.0
    if kind == "sector":
        start = rng.integers(0, 8) * np.pi / 4
        sweep = rng.integers(1, 8) * np.pi / 4
        values |= {"start_angle": start, "end_angle": start + sweep, "zero": b}
    return Shape("frustum", values)
