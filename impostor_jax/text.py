"""What `print` shows of shapes and fits: values with their units."""

__all__ = ["described", "text_or_repr"]

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import numpy as np

from impostor_jax.arguments import is_exact

MOST_VALUES = 9
"""A larger array is told by its shape."""


def text_or_repr(module: eqx.Module, text: Callable[[], str]) -> str:
    """The text, or the plain form where fields hold no numbers that can be read now.

    A tree may hold tracers, shapes, deleted arrays, or nothing where it was divided:
    printing it must not raise.
    """
    try:
        return text()
    except Exception:  # Whatever the leaves are: there is a form for all of them.
        return repr(module)


def described(
    module: Any, units: Mapping[str, str], values: Mapping[str, Any] | None = None
) -> str:
    """Name of a class and its fields, with their units, on one line.

    Left out is what is None, and a flag that is True, as it is by default. Several
    modules have a line each, after that, with their numbers.

    Args:
        module: A dataclass of arrays, strings and flags, or the class of `values`.
        units: Of the fields that are not in meters.
        values: What is told in place of the fields.
    """
    if values is None:
        names = [field.name for field in dataclasses.fields(module)]
        values = {name: getattr(module, name) for name in names}
    parts, lines = [], []
    for name, value in values.items():
        if isinstance(value, tuple) and all(isinstance(x, eqx.Module) for x in value):
            lines += [f"\n  {k} {described(x, units)}" for k, x in enumerate(value)]
        elif value is not None and value is not True:
            parts.append(f"{name} {_value(value, units.get(name, 'm'))}")
    return f"{type(module).__name__}: {', '.join(parts)}{''.join(lines)}"


def _value(value: Any, unit: str) -> str:
    if isinstance(value, bool | str | tuple):
        return str(value)
    if not isinstance(value, jax.Array | np.ndarray | np.number | float):
        return type(value).__name__
    array = np.asarray(value, dtype=float)
    if array.size > MOST_VALUES:
        text = f"of shape {array.shape}"
    else:
        # What lies far off is known to more digits.
        text = _numbers(array, ".10g" if is_exact(value) else ".6g")
    return f"{text} {unit}".rstrip()


def _numbers(array: np.ndarray | np.number, form: str) -> str:
    if array.ndim == 0:
        return format(float(array), form)
    return f"({', '.join(_numbers(part, form) for part in array)})"
