"""The records of a fit of any shape, and of a search, as JSON."""

__all__ = ["fit_record", "found_record", "numbers", "shape_of_fit"]

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.find.found import Found
from impostor_jax.fit.result import BoreTest, Fit, TaperTest, named_values
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.io.json_file import arguments_of, check_keys
from impostor_jax.primitives import PRIMITIVES
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.tube import tube

MADE_BY: dict[str, Callable[..., AbstractPrimitive]] = {**PRIMITIVES, "tube": tube}
"""Shapes that a record may be of, by what makes them."""


def fit_record(
    fit: Fit,
    seconds: float,
    taper: TaperTest | None = None,
    bore: BoreTest | None = None,
) -> dict[str, Any]:
    """Turn a fit into what JSON can hold; infinite standard deviations become null.

    Args:
        fit: A single, concrete result.
        seconds: Time that the fit took.
        taper: Whether a frustum is needed, if that was tested.
        bore: Whether a tube is needed, if that was tested.
    """
    return {
        "success": bool(fit.success),
        "status": str(fit.status),
        "reason": fit.reason,
        "shape": fit.kind,
        **_estimate(fit),
        "ends_seen": [bool(seen) for seen in fit.ends_seen],
        "height_observed": fit.height_observed,
        "covariance": {
            "coordinates": list(fit.coordinates),
            "values": numbers(fit.covariance),
        },
        "num_starts": int(fit.num_starts),
        "num_agreeing": int(fit.num_agreeing),
        "alternatives": [
            {"weight": weight, **_named(values)}
            for weight, values in fit.alternatives.told(named_values)
        ],
        "num_pixels": int(fit.num_pixels),
        "rms_m": numbers(fit.rms),
        "chi2": numbers(fit.chi2),
        "taper": None if taper is None else _taper(taper),
        "bore": None if bore is None else _bore(bore),
        "seconds": seconds,
    }


def shape_of_fit(record: dict[str, Any], what: str) -> AbstractPrimitive:
    """Make the shape of a fit's record.

    Args:
        record: As `fit_record` makes it.
        what: Names it in errors.

    Raises:
        ValueError: The fit failed, or something is missing or no number.
    """
    name = record["shape"]
    if not isinstance(name, str) or name not in MADE_BY:
        raise ValueError(
            f"shape of {what} must be one of {', '.join(MADE_BY)}; got {name!r}"
        )
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
    cylinders = [
        {
            "label": k + 1,
            "confidence": numbers(found.confidence[k]),
            "visible": numbers(found.visible[k]),
            "inside": bool(found.inside[k]),
            "status": str(fit.status),
            "world_from_cylinder": _pose(fit.cylinder),
            **_estimate(fit),
            "ends_seen": [bool(seen) for seen in fit.ends_seen],
            "num_pixels": int(fit.num_pixels),
            "rms_m": numbers(fit.rms),
            "chi2": numbers(fit.chi2),
        }
        for k, fit in enumerate(found.fits)
    ]
    planes = zip(found.planes.point, found.planes.unit_normal, strict=True)
    return {
        "frame": f"the camera's: {axes}" if is_camera else "the world's",
        "image": {"width": camera.width, "height": camera.height},
        "cylinders": cylinders,
        "planes": [
            {"point_m": numbers(point), "normal": numbers(normal)}
            for point, normal in planes
        ],
        "seconds": seconds,
        "made_from": made_from,
    }


def _pose(cylinder: Cylinder) -> list[list[float]]:
    """Matrix to the world from the frame at the center whose z is the axis."""
    pose, axis = np.eye(4), jnp.asarray(cylinder.axis)
    pose[:3, :2] = np.asarray(tangent_basis(axis)).T
    pose[:3, 2], pose[:3, 3] = axis, cylinder.center
    return numbers(pose)


def _taper(taper: TaperTest) -> dict[str, Any]:
    return {
        "needed": bool(taper.is_needed()),
        "statistic": numbers(taper.statistic),
        "p_value": numbers(taper.p_value),
        "frustum_status": str(taper.frustum.status),
        **_estimate(taper.frustum),
    }


def _bore(bore: BoreTest) -> dict[str, Any]:
    return {
        "needed": bool(bore.is_needed()),
        "statistic": numbers(bore.statistic),
        "p_value": numbers(bore.p_value),
        "tube_status": str(bore.tube.status),
        **_estimate(bore.tube),
    }


def _estimate(fit: Fit) -> dict[str, Any]:
    """Values by name and unit, their deviations, and what these are made of."""
    told = fit.told

    def of_all(std: Any) -> dict[str, Any]:
        return {
            name + ("_rad" if name == "axis" else "_m"): numbers(getattr(std, name))
            for name in told
        }

    values = {name: value for name, (value, _) in told.items()}
    budget = {name: of_all(std) for name, std in fit.std_budget.some.items()}
    return _named(values) | {"std": of_all(fit.std), "std_budget": budget}


def _named(values: dict[str, Any]) -> dict[str, Any]:
    """Lengths, points and an axis, by name and unit."""
    return {
        name if name == "axis" else f"{name}_m": numbers(value)
        for name, value in values.items()
    }


def numbers(values: Any) -> Any:
    """Numbers as (lists of) Python floats, null where not finite."""
    array = np.asarray(values, dtype=float)
    if array.ndim:
        return [numbers(value) for value in array]
    return float(array) if np.isfinite(array) else None
