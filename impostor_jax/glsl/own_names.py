"""A shape's shader under names of its own, so that several kinds stand in one source.

All names of one shape's meaning (`intersect`, the fields) are replaced by the kind's
own. The fields are variables, `take`n from a texture before a ray is cast at a shape.
"""

__all__ = ["TYPES", "named_apart"]

from collections.abc import Iterable

from impostor_jax.glsl.impostor import Impostor

TYPES = {1: "float", 2: "vec2", 3: "vec3", 4: "vec4", 9: "mat3"}
"""GLSL's types by their numbers of components."""

NAMES = (
    "take",
    "intersect",
    "stretches",
    "normal_at",
    "listed",
    "meet",
    "blocks",
    "inside",
    "ends",
    "NUM_ENDS",
    "cross_all",
    "is_in",
)
"""That each kind of shape has of its own, beside its fields."""


def named_apart(
    impostor: Impostor, texts: Iterable[str], **constants: int
) -> list[str]:
    """Parts of a source that hold the shader of one kind of shape.

    Args:
        impostor: Of the kind.
        texts: Its sources.
        constants: Numbers that these read.
    """
    fields = _fields(impostor)
    own = {name: f"{impostor.name}_{name}" for name in (*fields, *NAMES)}
    own |= {name: str(value) for name, value in constants.items()}
    parts = [f"#define {name} {mine}\n" for name, mine in own.items()]
    parts += [_taken(fields, impostor.texels), *texts]
    return parts + [f"#undef {name}\n" for name in own]


def _fields(impostor: Impostor) -> dict[str, int]:
    """What a shape is told, in the order of the columns of `DrawCall.rows`."""
    return {**impostor.fields, **dict.fromkeys(impostor.counters, 1)}


def _taken(fields: dict[str, int], texels: int) -> str:
    """The fields as variables, and the function that reads those of a shape."""
    declared, body, first = "", "", 0
    for k in range(texels):
        body += f"    vec4 v{k} = number_at(place + {k});\n"
    for name, count in fields.items():
        declared += f"{TYPES[count]} {name};\n"
        given = [f"v{k // 4}.{'xyzw'[k % 4]}" for k in range(first, first + count)]
        value = f"{TYPES[count]}({', '.join(given)})"
        # The numbers of a matrix come row by row.
        body += f"    {name} = {f'transpose({value})' if count == 9 else value};\n"
        first += count
    return f"{declared}\nvoid take(int place) {{\n{body}}}\n\n"
