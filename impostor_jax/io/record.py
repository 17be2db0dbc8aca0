"""The record of a fit of any shape, as JSON."""

__all__ = ["fit_record", "numbers"]

from typing import Any

import numpy as np

from impostor_jax.fit.result import Fit, TaperTest


def fit_record(
    fit: Fit, seconds: float, taper: TaperTest | None = None
) -> dict[str, Any]:
    """Turn a fit into what JSON can hold; infinite standard deviations become null.

    Args:
        fit: A single, concrete result.
        seconds: Time that the fit took.
        taper: Whether a frustum is needed, if that was tested.
    """
    return {
        "success": bool(fit.success),
        "status": str(fit.status),
        "reason": fit.reason,
        "shape": type(fit.shape).__name__.lower(),
        **_estimate(fit),
        "ends_seen": [bool(seen) for seen in fit.ends_seen],
        "height_observed": fit.height_observed,
        "covariance": {
            "coordinates": list(fit.coordinates),
            "values": numbers(fit.covariance),
        },
        "num_starts": int(fit.num_starts),
        "num_agreeing": int(fit.num_agreeing),
        "num_pixels": int(fit.num_pixels),
        "rms_m": numbers(fit.rms),
        "chi2": numbers(fit.chi2),
        "taper": None if taper is None else _taper(taper),
        "seconds": seconds,
    }


def _taper(taper: TaperTest) -> dict[str, Any]:
    return {
        "needed": bool(taper.is_needed()),
        "statistic": numbers(taper.statistic),
        "p_value": numbers(taper.p_value),
        "frustum_status": str(taper.frustum.status),
        **_estimate(taper.frustum),
    }


def _estimate(fit: Fit) -> dict[str, Any]:
    """Values by name and unit, and their standard deviations."""
    values, std = {}, {}
    for name, (value, deviation) in fit.told.items():
        is_axis = name == "axis"
        values[name if is_axis else f"{name}_m"] = numbers(value)
        std[name + ("_rad" if is_axis else "_m")] = numbers(deviation)
    return values | {"std": std}


def numbers(values: Any) -> Any:
    """Numbers as (lists of) Python floats, null where not finite."""
    array = np.asarray(values, dtype=float)
    if array.ndim:
        return [numbers(value) for value in array]
    return float(array) if np.isfinite(array) else None
