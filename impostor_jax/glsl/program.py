"""The shaders' sources, put together as each dialect of GLSL wants them."""

__all__ = [
    "SAMPLES_PER_ROW",
    "TEXELS_PER_ROW",
    "attributes",
    "head_of",
    "mark_sources",
    "shader_sources",
    "texts_of",
]

from collections.abc import Callable
from importlib import resources
from pathlib import Path

import numpy as np

from impostor_jax.glsl.conventions import GLSL
from impostor_jax.glsl.impostor import Impostor
from impostor_jax.glsl.own_names import TYPES, named_apart
from impostor_jax.glsl.solid_program import kind_files, solid_text
from impostor_jax.numerics import eps, smallest_slope

HEADERS = {
    "330": "#version 330 core\n",
    "300 es": "#version 300 es\nprecision highp float;\nprecision highp int;\n",
}
"""First lines of a shader: desktop OpenGL 3.3 and WebGL2."""

SAMPLES_PER_ROW = 1024
"""Width of the texture that holds samples."""

TEXELS_PER_ROW = 1024
"""Width of the texture that holds numbers, four together."""


def attributes(impostor: Impostor) -> list[tuple[str, int]]:
    """Names and numbers of components of what each instance has, in order."""
    found = []
    for name, count in impostor.fields.items():
        # An attribute holds four numbers at most: a matrix comes row by row.
        rows = [f"{name}_{row}" for row in range(3)] if count == 9 else [name]
        found += [(f"instance_{row}", count // len(rows)) for row in rows]
    return [*found, *((f"instance_{name}", 1) for name in _counters(impostor))]


def _counters(impostor: Impostor) -> tuple[str, ...]:
    """What each instance is told of its place among those that are drawn."""
    return (*impostor.counters, "index")


def shader_sources(
    impostor: Impostor,
    dialect: str,
    orthographic: bool,
    shaders: Path | None = None,
    ending: str = "main.frag",
) -> tuple[str, str]:
    """Vertex and fragment shader of a primitive.

    Args:
        impostor: How the primitive is drawn.
        dialect: "330" or "300 es".
        orthographic: Whether the camera's rays are parallel.
        shaders: Folder whose files take the place of those of the same names.
        ending: File of what each fragment does with the surface that it meets.

    Raises:
        ValueError: There is no such folder.
    """
    text, head = texts_of(shaders), head_of(dialect, orthographic)
    billboard = text(f"{impostor.billboard or impostor.name}.vert", "whole_image.vert")
    vertex = text("billboard.glsl") + billboard + text("main.vert")
    fragment = text("rays.glsl") + _drawn(impostor, text) + text(ending)
    return (
        head + _handed_over(impostor) + vertex,
        head + _declared(impostor, "in") + fragment,
    )


def mark_sources(name: str, dialect: str) -> tuple[str, str]:
    """Vertex and fragment shader of what is no primitive: points or lines of a page.

    Args:
        name: Stem of the files' names.
        dialect: As of `shader_sources`.
    """
    text, head = texts_of(None), head_of(dialect, orthographic=False)
    vertex = text("marks.glsl") + text(f"{name}.vert")
    return head + vertex, head + text(f"{name}.frag")


def _drawn(impostor: Impostor, text: Callable[..., str]) -> str:
    """The source that meets a ray with a primitive."""
    structure = impostor.structure
    if structure is None:
        return "".join(map(text, kind_files(impostor)))
    parts = [text("numbers.glsl"), text("stretch.glsl")]
    for kind in structure.impostors.values():
        parts += named_apart(kind, map(text, kind_files(kind, in_solids=True)))
    return "".join([*parts, solid_text(structure, text)])


def head_of(dialect: str, orthographic: bool) -> str:
    """What every shader begins with: dialect, constants and the camera's uniforms."""
    head = f"#define SMALLEST_SLOPE {smallest_slope(np.float32):.9e}\n"
    head += f"#define EPS {eps(np.float32):.9e}\n"
    head += f"#define SAMPLES_PER_ROW {SAMPLES_PER_ROW}\n"
    head += f"#define TEXELS_PER_ROW {TEXELS_PER_ROW}\n"
    if orthographic:
        head += "#define ORTHOGRAPHIC\n"
    return HEADERS[dialect] + head + GLSL


def texts_of(shaders: Path | None) -> Callable[..., str]:
    """What reads the first of some files that there is.

    Args:
        shaders: Folder whose files take the place of those of the same names.

    Raises:
        ValueError: There is no such folder.
    """
    if shaders is not None and not shaders.is_dir():
        raise ValueError(f"shaders must be a folder with shaders, got {shaders}")
    own = resources.files("impostor_jax.glsl") / "shaders"
    folders = (own,) if shaders is None else (shaders, own)

    def text(*names: str) -> str:
        files = (folder / name for name in names for folder in folders)
        return next(file.read_text() for file in files if file.is_file())

    return text


def _declared(impostor: Impostor, way: str) -> str:
    """The fields and the counters as variables that a whole instance shares."""
    fields = {**impostor.fields, **dict.fromkeys(_counters(impostor), 1)}
    return "".join(
        f"flat {way} {TYPES[count]} {name};\n" for name, count in fields.items()
    )


def _handed_over(impostor: Impostor) -> str:
    """An instance's attributes, and how the vertex shader hands them over."""
    inputs = "".join(
        f"layout(location = {place}) in {TYPES[count]} {name};\n"
        for place, (name, count) in enumerate(attributes(impostor))
    )
    body = "".join(f"    {name} = instance_{name};\n" for name in _counters(impostor))
    for name, count in impostor.fields.items():
        value = f"instance_{name}"
        if count == 9:
            rows = ", ".join(f"{value}_{row}" for row in range(3))
            value = f"transpose(mat3({rows}))"
        body += f"    {name} = {value};\n"
    return inputs + _declared(impostor, "out") + f"void take_instance() {{\n{body}}}\n"
