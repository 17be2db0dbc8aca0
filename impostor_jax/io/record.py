"""The record of a fit, as JSON."""

__all__ = ["fit_record", "numbers"]

from typing import Any

import numpy as np

from impostor_jax.fit.parameterization import COORDINATES
from impostor_jax.fit.result import FitResult, TaperTest


def fit_record(fit: FitResult, seconds: float) -> dict[str, Any]:
    """Turn a fit into what JSON can hold; infinite deviations become null.

    Args:
        fit: A single, concrete result.
        seconds: Time that the fit took.
    """
    cylinder, std = fit.cylinder, fit.std
    return {
        "success": bool(fit.success),
        "status": str(fit.status),
        "center_m": numbers(cylinder.center),
        "axis": numbers(cylinder.axis),
        "radius_m": numbers(cylinder.radius),
        "height_m": numbers(cylinder.height),
        "height_observed": fit.height_observed,
        "std": {
            "center_m": numbers(std.center),
            "axis_rad": numbers(std.axis),
            "radius_m": numbers(std.radius),
            "height_m": numbers(std.height),
        },
        "covariance": {
            "coordinates": list(COORDINATES),
            "values": numbers(fit.covariance),
        },
        "num_starts": int(fit.num_starts),
        "num_agreeing": int(fit.num_agreeing),
        "num_pixels": int(fit.num_pixels),
        "rms_m": numbers(fit.rms),
        "taper": None if fit.taper is None else _taper(fit.taper),
        "seconds": seconds,
    }


def _taper(taper: TaperTest) -> dict[str, Any]:
    frustum, std = taper.frustum.frustum, taper.frustum.std
    return {
        "needed": bool(taper.is_needed()),
        "statistic": numbers(taper.statistic),
        "p_value": numbers(taper.p_value),
        "frustum_status": str(taper.frustum.status),
        "p1_m": numbers(frustum.p1),
        "p2_m": numbers(frustum.p2),
        "radius1_m": numbers(frustum.radius1),
        "radius2_m": numbers(frustum.radius2),
        "std": {
            "p1_m": numbers(std.p1),
            "p2_m": numbers(std.p2),
            "radius1_m": numbers(std.radius1),
            "radius2_m": numbers(std.radius2),
        },
    }


def numbers(values: Any) -> Any:
    """Numbers as (lists of) Python floats, null where not finite."""
    array = np.asarray(values, dtype=float)
    if array.ndim:
        return [numbers(value) for value in array]
    return float(array) if np.isfinite(array) else None
