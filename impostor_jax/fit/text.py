"""Lines that tell a fit to a reader: lengths in millimeters, angles in degrees."""

__all__ = ["cylinder_rows", "frustum_rows", "millimeters", "sphere_rows"]

from typing import Any

import numpy as np

from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.sphere import Sphere


def millimeters(values: Any) -> str:
    """Lengths side by side, in millimeters."""
    return _numbers(values, 1e3)


def cylinder_rows(cylinder: Cylinder, std: Any) -> list[str]:
    """Lines of a cylinder and its deviations."""
    return [
        _lengths("center", cylinder.center, std.center),
        _direction(cylinder.axis, std.axis),
        _lengths("radius", cylinder.radius, std.radius),
        _lengths("height", cylinder.height, std.height),
    ]


def frustum_rows(frustum: Frustum, std: Any) -> list[str]:
    """Lines of a frustum and its deviations."""
    return [
        _lengths("p1", frustum.p1, std.p1),
        _lengths("p2", frustum.p2, std.p2),
        _direction(frustum.axis, std.axis),
        _lengths("radius1", frustum.radius1, std.radius1),
        _lengths("radius2", frustum.radius2, std.radius2),
    ]


def sphere_rows(sphere: Sphere, std: Any) -> list[str]:
    """Lines of a sphere and its deviations."""
    return [
        _lengths("center", sphere.center, std.center),
        _lengths("radius", sphere.radius, std.radius),
    ]


def _numbers(values: Any, factor: float = 1.0, digits: int = 3) -> str:
    return " ".join(f"{factor * x:.{digits}f}" for x in np.atleast_1d(values))


def _lengths(name: str, values: Any, deviations: Any) -> str:
    return f"  {name:<8}{millimeters(values)} mm  (std {millimeters(deviations)})"


def _direction(axis: Any, deviations: Any) -> str:
    tilt = _numbers(np.degrees(np.asarray(deviations)))
    return f"  axis    {_numbers(axis, digits=5)}  (std {tilt} degrees)"
