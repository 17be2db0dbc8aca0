"""Lines that tell a fit to a reader: lengths in millimeters, angles in degrees."""

__all__ = ["as_sentence", "line", "millimeters", "plain"]

from typing import Any

import numpy as np

from impostor_jax.fit.budget import ANGLES


def as_sentence(text: str) -> str:
    """The same with a capital letter first."""
    return text[:1].upper() + text[1:]


def millimeters(values: Any) -> str:
    """Lengths side by side, in millimeters."""
    return _numbers(values, 1e3)


def plain(name: str, values: Any) -> str:
    """A length, a point or an axis by its name."""
    if name in ANGLES:
        return f"{name} {_numbers(np.ravel(values), digits=5)}"
    return f"{name} {millimeters(values)} mm"


def line(name: str, values: Any, deviations: Any) -> str:
    """Line of a length, a point or an axis, and its standard deviations."""
    if name in ANGLES:
        tilt = _numbers(np.degrees(np.asarray(deviations)))
        told = _numbers(np.ravel(values), digits=5)
        return f"  {name:<7} {told}  (std {tilt} degrees)"
    return f"  {name:<7} {millimeters(values)} mm  (std {millimeters(deviations)})"


def _numbers(values: Any, factor: float = 1.0, digits: int = 3) -> str:
    return " ".join(f"{factor * x:.{digits}f}" for x in np.atleast_1d(values))
