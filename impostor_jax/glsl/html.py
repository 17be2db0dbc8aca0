"""Self-contained pages: a template, the scripts that it includes, and what is drawn."""

__all__ = ["html_page", "packed", "textures_message", "traced_message"]

import base64
import json
import re
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from impostor_jax.glsl.trace_list import TraceList
from impostor_jax.glsl.trace_program import trace_sources

INCLUDE = re.compile(r"INCLUDE (\S+)\n")
"""What stands in a template for a file of the package."""


def html_page(name: str, message: dict[str, Any]) -> str:
    """A page with all that it needs.

    Args:
        name: File name of the template, in the package; it says which files it
            includes.
        message: What the page's script finds in the element "scene".
    """
    # A script ends at the first "</", even inside a string, and "<!--" is no better.
    text = json.dumps(message, allow_nan=False).replace("<", "\\u003c")
    return _whole(name).replace("SCENE_JSON", text)


def _whole(name: str) -> str:
    """A file of the package, with those that it includes."""
    text = (resources.files("impostor_jax") / name).read_text()
    return INCLUDE.sub(lambda found: _whole(found[1]), text)


def traced_message(
    told: TraceList, shaders: Path | None = None, for_screen: bool = False
) -> dict[str, Any]:
    """What the script's `useTraced` takes.

    Args:
        told: What is traced.
        shaders: As of `OffscreenRenderer`.
        for_screen: As of `trace_sources`.
    """
    return {
        "sources": trace_sources(told.key, "300 es", shaders, for_screen),
        "uniforms": told.uniforms,
        "places": told.places,
        "textures": textures_message(told.textures),
    }


def textures_message(
    textures: dict[str, Float[np.ndarray, "..."]],
) -> dict[str, dict[str, Any]]:
    """What the script's `bindTextures` takes: as short as it can be, and exact."""
    found = {}
    for name, texels in textures.items():
        height, width, *each = texels.shape
        found[name] = {
            "size": [width, height],
            "each": each[0] if each else 1,
            "base64": packed(texels),
        }
    return found


def packed(values: Any) -> str:
    """Numbers as base64 of 32-bit floats, the lowest byte first."""
    return base64.b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode()
