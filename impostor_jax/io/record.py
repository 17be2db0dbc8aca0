"""The record of a fit, as JSON."""

__all__ = ["fit_record"]

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
        "center_m": _numbers(cylinder.center),
        "axis": _numbers(cylinder.axis),
        "radius_m": _numbers(cylinder.radius),
        "height_m": _numbers(cylinder.height),
        "height_observed": fit.height_observed,
        "std": {
            "center_m": _numbers(std.center),
            "axis_rad": _numbers(std.axis),
            "radius_m": _numbers(std.radius),
            "height_m": _numbers(std.height),
        },
        "covariance": {
            "coordinates": list(COORDINATES),
            "values": _numbers(fit.covariance),
        },
        "num_starts": int(fit.num_starts),
        "num_agreeing": int(fit.num_agreeing),
        "num_pixels": int(fit.num_pixels),
        "rms_m": _numbers(fit.rms),
        "taper": None if fit.taper is None else _taper(fit.taper),
        "seconds": seconds,
    }


def _taper(taper: TaperTest) -> dict[str, Any]:
    frustum, std = taper.frustum.frustum, taper.frustum.std
    return {
        "needed": bool(taper.is_needed()),
        "statistic": _numbers(taper.statistic),
        "p_value": _numbers(taper.p_value),
        "frustum_status": str(taper.frustum.status),
        "p1_m": _numbers(frustum.p1),
        "p2_m": _numbers(frustum.p2),
        "radius1_m": _numbers(frustum.radius1),
        "radius2_m": _numbers(frustum.radius2),
        "std": {
            "p1_m": _numbers(std.p1),
            "p2_m": _numbers(std.p2),
            "radius1_m": _numbers(std.radius1),
            "radius2_m": _numbers(std.radius2),
        },
    }


def _numbers(values: Any) -> Any:
    """Numbers as (lists of) Python floats, null where not finite."""
    array = np.asarray(values, dtype=float)
    if array.ndim:
        return [_numbers(value) for value in array]
    return float(array) if np.isfinite(array) else None
