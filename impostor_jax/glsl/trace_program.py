"""The shader that traces a scene, put together of the shapes that the scene holds.

Each shape's `intersect`, the one that draws it, stands in the source once, under names
of its own (`own_names`), and so do what all shapes have (`each.glsl`) and, where
something lets light through, its `<name>_inside.glsl`. The shapes that solids are made
of share them.

Inside a shape is where `AbstractPrimitive.implicit` is negative: within a solid, capped
or not; on the side of a plane or triangle that its normal points away from; below a
heightfield. As in `rendering.paths`, it is asked of the middle of the way to the hit.
"""

__all__ = ["TraceKey", "trace_sources"]

import dataclasses
from pathlib import Path

from impostor_jax.glsl.impostor import Impostor
from impostor_jax.glsl.own_names import named_apart
from impostor_jax.glsl.program import head_of, texts_of
from impostor_jax.glsl.solid_program import kind_files, solid_text


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
    head += f"#define BOUNCES {key.bounces}\n"
    head += "#define GLASS\n" if key.glass else ""
    head += "#define SCREEN\n" if for_screen else ""
    parts = [text("rays.glsl"), text("numbers.glsl"), text("traced.glsl")]
    solids = [kind.structure for kind in key.impostors if kind.structure]
    leaves = {k: v for solid in solids for k, v in solid.impostors.items()}
    parts += [text("stretch.glsl")] if solids else []
    # Shapes before the solids that are made of them.
    number_of = {impostor.name: k for k, impostor in enumerate(key.impostors)}
    shapes = leaves | {i.name: i for i in key.impostors if not i.structure}
    for kind in (*shapes.values(), *(i for i in key.impostors if i.structure)):
        if kind.structure:
            texts = [solid_text(kind.structure, text, key.glass)]
        else:
            files = kind_files(kind, kind.name in leaves, key.glass)
            texts = list(map(text, files))
        constants = {}
        if kind.name in number_of:
            texts.append(text("each.glsl"))
            constants = {"KIND": number_of[kind.name], "TEXELS": kind.texels}
        parts += named_apart(kind, texts, **constants)
    names = [impostor.name for impostor in key.impostors]
    parts += [_asked(names, key.glass), text("trace.frag")]
    return head + text("trace.vert"), head + "".join(parts)


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
