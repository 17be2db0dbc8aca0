"""What is made of the record of a fit, and the record of a search, as JSON."""

__all__ = ["found_in_points_record", "found_record", "shape_of_fit"]

from collections.abc import Callable
from typing import Any

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.find.found import Found, FoundInPoints
from impostor_jax.fit.record import FIT_VERSION
from impostor_jax.io.json_file import arguments_of, check_keys, check_version
from impostor_jax.plain_arguments import one_of
from impostor_jax.primitives import PRIMITIVES
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.tube import tube

MADE_BY: dict[str, Callable[..., AbstractPrimitive]] = {**PRIMITIVES, "tube": tube}
"""Shapes that a record may be of, by what makes them."""


def shape_of_fit(record: dict[str, Any], what: str) -> AbstractPrimitive:
    """Make the shape of a fit's record.

    Args:
        record: As `Fit.to_dict` makes it.
        what: Names it in errors.

    Raises:
        ValueError: It is of a newer version, the fit failed, or something is missing
            or no number.
    """
    check_version(record, FIT_VERSION, what)
    name = record["shape"]
    one_of(f"shape of {what}", name, MADE_BY)
    if record.get("success") is not True:
        raise ValueError(
            f"{what} must have succeeded, got the status {record.get('status')!r}"
        )
    keys = {
        argument: argument if argument == "axis" else f"{argument}_m"
        for argument, parameter in arguments_of(MADE_BY[name]).items()
        if parameter.default is parameter.empty
    }
    check_keys(record, keys.values(), record, what)
    try:
        return MADE_BY[name](**{key: record[keys[key]] for key in keys})
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what}: {error}") from error


def found_record(
    found: Found,
    camera: AbstractCamera,
    seconds: float,
    made_from: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Turn the cylinders of an image into what JSON can hold.

    Args:
        found: The result.
        camera: That took the image.
        seconds: Time that the search took.
        made_from: What it depends on, if that is to be told.
    """
    is_camera = camera.camera_from_world is None
    axes = "x right, y down, z forward"
    record = found.to_dict()
    return {
        "version": record["version"],
        "frame": f"the camera's: {axes}" if is_camera else "the world's",
        "image": {"width": camera.width, "height": camera.height},
        "cylinders": record["cylinders"],
        "planes": record["planes"],
        "seconds": seconds,
        "made_from": made_from,
    }


def found_in_points_record(
    found: FoundInPoints, seconds: float, made_from: dict[str, Any] | None = None
) -> dict[str, Any]:
    """Turn the cylinders of a cloud into what JSON can hold.

    Args:
        found: The result.
        seconds: Time that the search took.
        made_from: What it depends on, if that is to be told.
    """
    record = found.to_dict()
    return {
        "version": record["version"],
        "frame": "the points'",
        "cloud": {"points": len(found.labels), "searched": found.num_searched},
        "cylinders": record["cylinders"],
        "planes": record["planes"],
        "seconds": seconds,
        "made_from": made_from,
    }
