"""The shader of a solid made of others, written from how it is made.

Each kind of its shapes stands in the source once, under names of its own. From the
expression come a function that finds the ends of a ray's stretches in all shapes, one
that tells of a place whether it is in the solid, and one that asks the shape that is
seen for its normal; `solid.frag` calls them.
"""

__all__ = ["kind_files", "solid_text"]

from collections.abc import Callable, Iterator, Sequence

from impostor_jax.glsl.impostor import Impostor, Leaf, Structure
from impostor_jax.primitives.solid import Expression

JOINS = {"union": " || ", "intersection": " && ", "difference": " && !"}


def kind_files(
    impostor: Impostor, in_solids: bool = False, glass: bool = False
) -> list[str]:
    """Names of the files that a kind of shapes is told of by.

    Args:
        impostor: Of the kind.
        in_solids: Whether solids are made of it.
        glass: Whether it is asked if a point is inside.
    """
    name = impostor.name
    told = {
        "samples.glsl": impostor.samples,
        f"{name}.frag": True,
        f"{name}_stretches.glsl": in_solids,
        f"{name}_inside.glsl": glass,
    }
    return [file for file, is_needed in told.items() if is_needed]


def solid_text(
    structure: Structure, text: Callable[..., str], glass: bool = False
) -> str:
    """Source that draws solids of a structure; the kinds of shapes stand before it.

    Args:
        structure: Theirs.
        text: What reads a file.
        glass: Whether they are asked if a point is inside.
    """
    parts = [_crossed(structure), _is_in(structure), _normal_at(structure)]
    parts.append(text("solid.frag"))
    return "".join([*parts, _inside(structure)] if glass else parts)


def _crossed(structure: Structure) -> str:
    """Where a ray crosses the surfaces of all shapes."""
    count = 2 * sum(leaf.num_stretches for leaf in structure.leaves)
    body, k = "", 0
    for (leaf, taken), part in zip(
        _taken(structure), structure.first_parts, strict=True
    ):
        body += f"    {taken}\n    one = {leaf.impostor.name}_stretches(o, d, other);\n"
        for name in ("one", "other")[: leaf.num_stretches]:
            for end in ("enter", "leave"):
                body += f"    ends[{k}] = counted_from({part}, {name}.{end});\n"
                k += 1
    return (
        f"const int NUM_ENDS = {count};\n\nEnd ends[NUM_ENDS];\n\n"
        "void cross_all(vec3 o, vec3 d) {\n    Stretch one, other;\n" + body + "}\n\n"
    )


def _is_in(structure: Structure) -> str:
    """Whether a place on the ray is in the solid."""
    values, k = [], 0
    for leaf in structure.leaves:
        stretches = range(k, k + 2 * leaf.num_stretches, 2)
        held = [f"(ends[{i}].t < t && t < ends[{i + 1}].t)" for i in stretches]
        values.append(f"({' || '.join(held)})")
        k += 2 * leaf.num_stretches
    said = _said(structure.expression, values)
    return f"bool is_in(float t) {{\n    return {said};\n}}\n\n"


def _normal_at(structure: Structure) -> str:
    """Normal at a point of a part of the surface."""
    body = ""
    for (leaf, taken), part in zip(
        _taken(structure), structure.first_parts, strict=True
    ):
        asked = f"{leaf.impostor.name}_normal_at(p, part - {part})"
        body += (
            f"    if (part < {part + leaf.num_parts}) {{\n"
            f"        {taken}\n        return {asked};\n    }}\n"
        )
    return f"vec3 normal_at(vec3 p, int part) {{\n{body}    return vec3(0.0);\n}}\n\n"


def _inside(structure: Structure) -> str:
    """Whether a point is in the solid."""
    body, values = "    vec3 q = (p - translation) * rotation;\n", []
    for number, (leaf, taken) in enumerate(_taken(structure)):
        body += f"    {taken}\n    bool in{number} = {leaf.impostor.name}_inside(q);\n"
        values.append(f"in{number}")
    said = _said(structure.expression, values)
    return f"bool inside(vec3 p) {{\n{body}    return {said};\n}}\n"


def _taken(structure: Structure) -> Iterator[tuple[Leaf, str]]:
    """Each leaf, and what makes its fields those of its kind."""
    for leaf, first in zip(structure.leaves, structure.first_numbers, strict=True):
        name = leaf.impostor.name
        taken = f"{name}_take(int(first_number) + {first});"
        if leaf.impostor.samples:
            taken += f" {name}_first_sample += first_sample;"
        yield leaf, taken


def _said(expression: Expression, values: Sequence[str]) -> str:
    """An expression of what is known of the shapes."""
    if isinstance(expression, int):
        return values[expression]
    name, terms = expression
    return f"({JOINS[name].join(_said(term, values) for term in terms)})"
