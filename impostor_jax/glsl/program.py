"""The shaders' sources, as each dialect of GLSL wants them."""

__all__ = ["ATTRIBUTES", "instances", "shader_sources"]

from importlib import resources

import numpy as np
from jaxtyping import Float

from impostor_jax.glsl.conventions import GLSL
from impostor_jax.numerics import smallest_slope
from impostor_jax.primitives.cylinder import Cylinder

HEADERS = {
    "330": "#version 330 core\n",
    "300 es": "#version 300 es\nprecision highp float;\nprecision highp int;\n",
}
"""First lines of a shader: desktop OpenGL 3.3 and WebGL2."""

ATTRIBUTES = (("cylinder_center", 3), ("cylinder_axis", 3), ("cylinder_size", 2))
"""Names and numbers of components of what each instance has, in order."""


def shader_sources(
    dialect: str, orthographic: bool, as_published: bool
) -> tuple[str, str]:
    """Vertex and fragment shader of the capped cylinder.

    Args:
        dialect: "330" or "300 es".
        orthographic: Whether the camera's rays are parallel.
        as_published: Whether to use the published formulas, with their faults.
    """
    defines = f"#define SMALLEST_SLOPE {smallest_slope(np.float32):.9e}\n"
    if orthographic:
        defines += "#define ORTHOGRAPHIC\n"
    if as_published:
        defines += "#define AS_PUBLISHED\n"
    folder = resources.files("impostor_jax.glsl") / "shaders"
    vertex, fragment = (
        HEADERS[dialect] + defines + GLSL + (folder / f"cylinder.{kind}").read_text()
        for kind in ("vert", "frag")
    )
    return vertex, fragment


def instances(cylinders: Cylinder) -> Float[np.ndarray, "n 8"]:
    """Attributes of cylinders (n,) in the camera frame, one row each."""
    sizes = np.stack([cylinders.radius, cylinders.height], axis=-1)
    rows = np.concatenate([cylinders.center, cylinders.axis, sizes], axis=-1)
    return np.ascontiguousarray(rows, dtype=np.float32)
