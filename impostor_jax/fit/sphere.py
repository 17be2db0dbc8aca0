"""Fit a sphere to a depth image."""

__all__ = ["fit_sphere"]

from collections.abc import Mapping, Sequence
from typing import Any

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.effort import Effort
from impostor_jax.fit.result import SphereFit
from impostor_jax.fit.shapes import SPHERE, fit_shape
from impostor_jax.primitives.sphere import Sphere


def fit_sphere(
    depth: Any,
    camera: PinholeCamera,
    mask: Any = None,
    sigma: Any = None,
    initial: Sphere | None = None,
    fixed: Sequence[str] = (),
    prior: Mapping[str, Any] | None = None,
    mask_meaning: str = "region",
    scale: str = "estimated",
    errors: str = "independent",
    effort: Effort | str = "balanced",
) -> SphereFit:
    """Fit center and radius of a sphere to a depth image.

    The likelihood, the starts and the covariance are those of `fit_cylinder`, and so is
    what may be traced and differentiated.

    Args:
        depth: (H, W), planar depth in meters; 0, NaN and infinity mean no reading.
        camera: The camera that took it.
        mask: (H, W), as in `fit_cylinder`.
        sigma: As in `fit_cylinder`.
        initial: Start of the fit, in the world frame; found from the image if None.
        fixed: "center" or "radius", which keeps the value that it has in `initial`.
        prior: For "center" and "radius", expected value and standard deviation in the
            world frame, in meters.
        mask_meaning: As in `fit_cylinder`.
        scale: As in `fit_cylinder`.
        errors: As in `fit_cylinder`.
        effort: As in `fit_cylinder`.

    Returns:
        The fit. A fit that failed says so in `status`, with infinite deviations.

    Raises:
        ValueError: As in `fit_cylinder`.
    """
    fit = fit_shape(
        SPHERE,
        depth,
        camera,
        mask,
        sigma=sigma,
        initial=initial,
        fixed=fixed,
        prior=prior,
        mask_meaning=mask_meaning,
        scale=scale,
        errors=errors,
        effort=effort,
    )
    assert isinstance(fit, SphereFit)
    return fit
