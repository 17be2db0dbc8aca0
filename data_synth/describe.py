"""What a preset draws, in words."""

__all__ = ["describe"]

import dataclasses
from typing import Any

from data_synth.appearance import Appearance
from data_synth.camera_draw import CameraDraw, ScannerDraw
from data_synth.preset import Preset, Rules
from data_synth.roughness import Roughness
from impostor_jax.sensor.base import AbstractDepthNoise

NESTED = (CameraDraw, ScannerDraw, Rules, Appearance, Roughness)
"""What has lines of its own."""


def describe(preset: Preset) -> str:
    """Its sentence, and a line for each of its fields."""
    return "\n".join([preset.sentence, *_lines(preset, "  ")])


def _lines(value: Any, indent: str) -> list[str]:
    lines = []
    for field in dataclasses.fields(value):
        if field.name == "sentence":
            continue
        part = getattr(value, field.name)
        if field.name == "scenery" and part:
            lines.append(f"{indent}{field.name}")
            for kind in part:
                lines.append(f"{indent}  {type(kind).__name__}")
                lines += _lines(kind, indent + "    ")
        elif isinstance(part, NESTED):
            lines += [f"{indent}{field.name}", *_lines(part, indent + "  ")]
        else:
            lines.append(f"{indent}{field.name:<20} {_words(part)}")
    return lines


def _words(value: Any) -> str:
    if value is None or value == ():
        return "none"
    if isinstance(value, tuple):
        return ", ".join(map(_words, value))
    if isinstance(value, AbstractDepthNoise):
        fields = dataclasses.fields(value)
        parts = {field.name: getattr(value, field.name) for field in fields}
        words = [
            _words(part)
            if isinstance(part, AbstractDepthNoise)
            else f"{name} {float(part):.4g}"
            for name, part in parts.items()
            # What is not known is not told.
            if part is not None
        ]
        return f"{type(value).__name__}({', '.join(words)})"
    return str(value)
