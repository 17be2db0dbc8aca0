"""Records of laser scanners: the angles of rows and columns, in degrees.

    {"model": "spherical", "elevation_deg": [15, 13, 11, 9, 7],
     "azimuth_deg": {"first": -179.8, "last": 179.8, "count": 900}}

What is evenly apart is told by its ends; anything else angle by angle. Nothing here
needs JAX, so that a command can refuse a file before JAX starts.
"""

__all__ = [
    "ANGLES",
    "MODEL",
    "angles_of",
    "angles_record",
    "check_spherical_record",
]

from typing import Any

import numpy as np
from jaxtyping import Float

from impostor_jax.io.json_file import check_keys
from impostor_jax.plain_arguments import MAX_PIXELS, image_size, whole_number

MODEL = "spherical"
"""What `model` is; of a pinhole camera there is none."""

ANGLES = ("elevation_deg", "azimuth_deg")
"""Keys of rows and of columns."""

RANGE = ("first", "last", "count")

EVEN = 1e-9
"""Degrees by which angles that are evenly apart may be off: 0.5 nm at 30 m."""


def check_spherical_record(record: dict[str, Any], what: str) -> None:
    """Raise a `ValueError` unless a record has the keys of a scanner, and a size.

    Args:
        record: As it was read; whether angles rise or fall is looked at where the
            camera is made.
        what: Names it in errors.
    """
    required = ("model", *ANGLES)
    check_keys(record, required, (*required, "depth_scale_m"), what)
    if record["model"] != MODEL:
        raise ValueError(
            f"{what}: model must be {MODEL!r}, or left out of a pinhole camera, got "
            f"{record['model']!r}"
        )
    try:
        height, width = (len(angles_of(record, name)) for name in ANGLES)
        image_size(width, height)
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from error


def angles_of(record: dict[str, Any], name: str) -> Float[np.ndarray, " n"]:
    """The angles of rows or of columns, in degrees, as a list or a range holds them.

    Raises:
        ValueError: It is neither, or holds what is no finite number.
    """
    value = record[name]
    if isinstance(value, dict):
        check_keys(value, RANGE, RANGE, name)
        count = whole_number(f"count of {name}", value["count"], 1, MAX_PIXELS)
        first, last = value["first"], value["last"]
        if _are_numbers([first, last]):
            return np.linspace(first, last, count)
    elif isinstance(value, list) and value and _are_numbers(value):
        return np.array(value, np.float64)
    raise ValueError(
        f"{name} must be a list of degrees, or a range with a first and a last of "
        f"degrees and a count, got {str(value)[:60]}"
    )


def angles_record(angles: Float[np.ndarray, " n"]) -> list[float] | dict[str, Any]:
    """What `angles_of` reads as these angles, in degrees."""
    # Without the last bits of a conversion from radians.
    angles = np.round(angles, 12)
    first, last, count = float(angles[0]), float(angles[-1]), len(angles)
    if count > 2 and np.abs(np.linspace(first, last, count) - angles).max() < EVEN:
        return {"first": first, "last": last, "count": count}
    return angles.tolist()


def _are_numbers(values: list[Any]) -> bool:
    """Whether all are degrees; True is a number to Python, and a mistake in a file."""
    return all(
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) <= 360
        for value in values
    )
