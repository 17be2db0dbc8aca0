"""The shader that traces a scene, put together of the shapes that the scene holds.

Each shape's `intersect`, the one that draws it, stands in the source once, with all its
names of one scene's meaning (`intersect`, the fields) replaced by the shape's own, and
so do what all shapes have (`each.glsl`) and, where something lets light through, its
`<name>_inside.glsl`. The fields are variables, `take`n from a texture before a ray is
cast at a shape.

Inside a shape is where `AbstractPrimitive.implicit` is negative: within a solid, capped
or not; on the side of a plane or triangle that its normal points away from; below a
heightfield. As in `rendering.paths`, it is asked of the middle of the way to the hit.
"""

__all__ = ["TEXELS_PER_ROW", "TraceKey", "texels_of", "trace_sources"]

import dataclasses
from pathlib import Path

from impostor_jax.glsl.impostors import Impostor
from impostor_jax.glsl.program import SAMPLES_PER_ROW, TYPES, head_of, texts_of

TEXELS_PER_ROW = 1024
"""Width of the texture that holds shapes, materials and lights."""


@dataclasses.dataclass(frozen=True)
class TraceKey:
    """What a shader is made for; scenes that have it in common share one.

    Attributes:
        impostors: Of the shapes, each once.
        orthographic: Whether the camera's rays are parallel.
        bounces: Most times that a ray is mirrored or bent.
        glass: Whether anything lets light through.
    """

    impostors: tuple[Impostor, ...]
    orthographic: bool
    bounces: int
    glass: bool


def texels_of(impostor: Impostor) -> int:
    """How many texels a shape's fields fill."""
    return -(-sum(_fields(impostor).values()) // 4)


def trace_sources(
    key: TraceKey,
    dialect: str,
    shaders: Path | None = None,
    for_screen: bool = False,
) -> tuple[str, str]:
    """Vertex and fragment shader that trace scenes.

    Args:
        key: What they are made for.
        dialect: "330" or "300 es".
        shaders: As of `shader_sources`.
        for_screen: Whether colors are those of sRGB, as a screen takes them; linear
            otherwise.

    Raises:
        ValueError: There is no such folder.
    """
    text = texts_of(shaders)
    head = head_of(dialect, key.orthographic)
    head += f"#define TEXELS_PER_ROW {TEXELS_PER_ROW}\n"
    head += f"#define SAMPLES_PER_ROW {SAMPLES_PER_ROW}\n"
    head += f"#define BOUNCES {key.bounces}\n"
    head += "#define GLASS\n" if key.glass else ""
    head += "#define SCREEN\n" if for_screen else ""
    parts = [text("rays.glsl"), text("traced.glsl")]
    for kind, impostor in enumerate(key.impostors):
        files = [f"{impostor.name}.frag", "each.glsl"]
        if impostor.samples:
            files.insert(0, "samples.glsl")
        if key.glass:
            files.append(f"{impostor.name}_inside.glsl")
        own = {name: f"{impostor.name}_{name}" for name in _names(impostor)}
        own |= {"KIND": str(kind), "TEXELS": str(texels_of(impostor))}
        parts += [f"#define {name} {mine}\n" for name, mine in own.items()]
        parts += [_taken(impostor), *map(text, files)]
        parts += [f"#undef {name}\n" for name in own]
    names = [impostor.name for impostor in key.impostors]
    parts += [_asked(names, key.glass), text("trace.frag")]
    return head + text("trace.vert"), head + "".join(parts)


def _names(impostor: Impostor) -> tuple[str, ...]:
    """Names that each kind of shape has of its own."""
    return (
        *_fields(impostor),
        "take",
        "intersect",
        "listed",
        "meet",
        "blocks",
        "inside",
    )


def _fields(impostor: Impostor) -> dict[str, int]:
    """What a shape is told, in the order of the columns of `DrawCall.rows`."""
    counter = {"first_sample": 1} if impostor.samples else {}
    return {**impostor.fields, **counter}


def _taken(impostor: Impostor) -> str:
    """The fields as variables, and the function that reads those of a shape."""
    declared, body, first = "", "", 0
    for k in range(texels_of(impostor)):
        body += f"    vec4 v{k} = number_at(place + {k});\n"
    for name, count in _fields(impostor).items():
        declared += f"{TYPES[count]} {name};\n"
        given = [f"v{k // 4}.{'xyzw'[k % 4]}" for k in range(first, first + count)]
        value = f"{TYPES[count]}({', '.join(given)})"
        # The numbers of a matrix come row by row.
        body += f"    {name} = {f'transpose({value})' if count == 9 else value};\n"
        first += count
    return f"{declared}\nvoid take(int place) {{\n{body}}}\n\n"


def _asked(names: list[str], glass: bool) -> str:
    """What is asked of all shapes of all kinds."""
    meets = "".join(f"    {name}_meet(o, d, met);\n" for name in names)
    blocks = " || ".join(f"{name}_blocks(o, d, reach)" for name in names)
    asked = (
        "\nMet first_met(vec3 o, vec3 d) {\n"
        f"    Met met = Met(MISS, -1, 0);\n{meets}    return met;\n}}\n\n"
        "bool is_blocked(vec3 o, vec3 d, float reach) {\n"
        f"    return {blocks};\n}}\n\n"
    )
    if not glass:
        return asked
    cases = "".join(
        f"    if (met.kind == {kind}) {{\n        {name}_take(met.place + FIELDS);\n"
        f"        return {name}_inside(p);\n    }}\n"
        for kind, name in enumerate(names)
    )
    return (
        f"{asked}bool is_inside(Met met, vec3 p) {{\n{cases}    return false;\n}}\n\n"
    )
