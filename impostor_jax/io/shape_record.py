"""The record of a fit of any shape, as JSON."""

__all__ = ["shape_record"]

from typing import Any

from impostor_jax.fit.parameterization import FRUSTUM_COORDINATES, SPHERE_COORDINATES
from impostor_jax.fit.result import AbstractFit, FitResult, FrustumFit, SphereFit
from impostor_jax.io.record import fit_record, numbers


def shape_record(fit: AbstractFit, seconds: float) -> dict[str, Any]:
    """Turn a fit into what JSON can hold; infinite deviations become null.

    Args:
        fit: A single, concrete result; that of a cylinder as `fit_record` has it.
        seconds: Time that the fit took.
    """
    if isinstance(fit, FitResult):
        return fit_record(fit, seconds)
    if isinstance(fit, SphereFit):
        name, lengths, coordinates = "sphere", ("center", "radius"), SPHERE_COORDINATES
        ends = {}
    else:
        assert isinstance(fit, FrustumFit)
        lengths = "p1", "p2", "radius1", "radius2"
        name, coordinates = "frustum", FRUSTUM_COORDINATES
        ends = {"ends_seen": [bool(seen) for seen in fit.ends_seen]}
    return {
        "success": bool(fit.success),
        "status": str(fit.status),
        "shape": name,
        **{f"{length}_m": numbers(getattr(fit.shape, length)) for length in lengths},
        **ends,
        "std": {f"{length}_m": numbers(getattr(fit.std, length)) for length in lengths},
        "covariance": {
            "coordinates": list(coordinates),
            "values": numbers(fit.covariance),
        },
        "num_starts": int(fit.num_starts),
        "num_agreeing": int(fit.num_agreeing),
        "num_pixels": int(fit.num_pixels),
        "rms_m": numbers(fit.rms),
        "seconds": seconds,
    }
