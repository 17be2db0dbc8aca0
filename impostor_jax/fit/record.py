"""The record of a fit of any shape, as JSON can hold it.

Its keys, and what they mean, are in `impostor_jax/io/schemas/fit.schema.json`; what
is no finite number is null.
"""

__all__ = ["FIT_VERSION", "estimate_record", "fit_record", "numbers"]

from typing import Any

import numpy as np

from impostor_jax.fit.alternatives import Named
from impostor_jax.fit.budget import ANGLES

FIT_VERSION = 1
"""Of the records that are written: one more for each change that a reader must know."""


def fit_record(
    fit: Any,
    alternatives: list[tuple[float, Named]],
    seconds: float | None,
    taper: Any,
    bore: Any,
) -> dict[str, Any]:
    """The record of a fit.

    Args:
        fit: A single, concrete `Fit`, which stands above this module.
        alternatives: Weight and named values of its other solutions.
        seconds: Time that it took, if that is to be told.
        taper: Its `TaperTest`, if there was one.
        bore: Its `BoreTest`, if there was one.
    """
    gap, errors = fit.outline_gap, fit.pose_errors
    return {
        "version": FIT_VERSION,
        "success": bool(fit.success),
        "status": str(fit.status),
        "reason": fit.reason,
        "shape": fit.kind,
        "source": fit.source,
        "world_from_object": numbers(fit.pose),
        **estimate_record(fit),
        "ends_seen": [bool(seen) for seen in fit.ends_seen],
        "height_observed": fit.height_observed,
        "stands": fit.stands,
        "covariance": {
            "coordinates": list(fit.coordinates),
            "values": numbers(fit.covariance),
        },
        "num_starts": int(fit.num_starts),
        "num_agreeing": int(fit.num_agreeing),
        "alternatives": [
            {"weight": weight, **_named(values)} for weight, values in alternatives
        ],
        "num_pixels": int(fit.num_pixels),
        "rms_m": numbers(fit.rms),
        "chi2": numbers(fit.chi2),
        "across_ray": {
            "deviation_m": numbers(fit.across.deviation),
            "found_m": numbers(fit.across.found),
            "score": numbers(fit.across.score),
        },
        "form": {
            "departs": bool(fit.form.departs),
            "chi2": numbers(fit.form.chi2),
            **{name: numbers(told) for name, told in fit.form.sizes.items()},
        },
        "pose_errors": errors
        and {
            "value": numbers(errors.value),
            "std": numbers(errors.std),
        },
        "outline_gap": gap and {name: numbers(x) for name, x in gap._asdict().items()},
        "taper": None if taper is None else _test(taper, "frustum"),
        "bore": None if bore is None else _test(bore, "tube"),
        "seconds": seconds,
    }


def estimate_record(fit: Any) -> dict[str, Any]:
    """Values of a `Fit` by name and unit, their deviations, and what these are of."""
    told = fit.told

    def of_all(std: Any) -> dict[str, Any]:
        return {
            name + ("_rad" if name in ANGLES else "_m"): numbers(getattr(std, name))
            for name in told
        }

    values = {name: value for name, (value, _) in told.items()}
    budget = {name: of_all(std) for name, std in fit.std_budget.some.items()}
    return _named(values) | {"std": of_all(fit.std), "std_budget": budget}


def _test(test: Any, shape: str) -> dict[str, Any]:
    """The record of a test of a cylinder against another shape."""
    fit = getattr(test, shape)
    return {
        "needed": bool(test.is_needed()),
        "statistic": numbers(test.statistic),
        "p_value": numbers(test.p_value),
        f"{shape}_status": str(fit.status),
        **estimate_record(fit),
    }


def _named(values: Named) -> dict[str, Any]:
    """Lengths, points and an axis, by name and unit."""
    return {
        name if name in ANGLES else f"{name}_m": numbers(value)
        for name, value in values.items()
    }


def numbers(values: Any) -> Any:
    """Numbers as (lists of) Python floats, null where not finite."""
    array = np.asarray(values, dtype=float)
    if array.ndim:
        return [numbers(value) for value in array]
    return float(array) if np.isfinite(array) else None
