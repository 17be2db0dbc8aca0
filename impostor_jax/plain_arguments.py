"""Checks of arguments that are plain values of Python's, for which JAX is not needed.

A command refuses a wrong flag or file with them before JAX starts, which takes seconds;
`impostor_jax.arguments` has the checks of what may be an array.
"""

__all__ = [
    "image_size",
    "number_in_range",
    "number_needed",
    "one_of",
    "plain_number",
    "whole_number",
]

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

MAX_PIXELS = 2**28
"""Most pixels of an image: a map of them takes a gigabyte in single precision."""

SMALLEST, LARGEST = 1.1e-19, 1.8e19
"""Ends of the numbers whose squares single precision holds, as `has_square` has it."""


def number_needed(*, positive: bool, unit: str | None) -> str:
    """What a number must be, for an error."""
    need = "a positive number" if positive else "a finite number"
    return need if unit is None else f"{need} in {unit}"


def number_in_range(name: str, number: float, need: str, *, positive: bool) -> float:
    """Return a number that is finite, positive if it must be, and has a square.

    Args:
        name: Name of the argument, for the error.
        number: Its value.
        need: As of `number_needed`.
        positive: Whether it must be.
    """
    if not math.isfinite(number) or (positive and number <= 0):
        raise ValueError(f"{name} must be {need}, got {number}")
    if abs(number) > LARGEST or (positive and number < SMALLEST):
        low = SMALLEST if positive else -LARGEST
        raise ValueError(
            f"{name} must be {need}, from {low:.3g} to {LARGEST:.3g}, got {number}"
        )
    return number


def plain_number(
    name: str, value: float, *, positive: bool = False, unit: str | None = None
) -> float:
    """Return a number as `impostor_jax.arguments.real_number` does."""
    need = number_needed(positive=positive, unit=unit)
    return number_in_range(name, float(value), need, positive=positive)


def image_size(width: Any, height: Any) -> tuple[int, int]:
    """Return the columns and rows of an image that can be held in memory."""
    width = whole_number("width", width, 1, unit="pixels")
    height = whole_number("height", height, 1, unit="pixels")
    if width * height > MAX_PIXELS:
        raise ValueError(
            f"width and height must be at most {MAX_PIXELS} pixels together, got "
            f"{width} x {height}"
        )
    return width, height


def whole_number(
    name: str, value: Any, low: int, high: int | None = None, unit: str = ""
) -> int:
    """Return a whole number of a range, both ends included; None is no end."""
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or value < low or (high is not None and value > high):
        need = f"of at least {low}" if high is None else f"from {low} to {high}"
        need += unit and f" {unit}"
        raise ValueError(f"{name} must be a whole number {need}, got {value!r}")
    return int(value)


def one_of(name: str, value: Any, allowed: Iterable[str]) -> None:
    """Raise unless `value` is one of the `allowed` names."""
    names = tuple(allowed)
    if value not in names:
        raise ValueError(f"{name} must be one of {', '.join(names)}; got {value!r}")
