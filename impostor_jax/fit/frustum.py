"""Fit a cone frustum to a depth image."""

__all__ = ["fit_frustum"]

from collections.abc import Mapping, Sequence
from typing import Any

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.effort import Effort
from impostor_jax.fit.result import FrustumFit
from impostor_jax.fit.shapes import FRUSTUM, fit_shape
from impostor_jax.primitives.frustum import Frustum


def fit_frustum(
    depth: Any,
    camera: PinholeCamera,
    mask: Any = None,
    sigma: Any = None,
    initial: Frustum | None = None,
    fixed: Sequence[str] = (),
    prior: Mapping[str, Any] | None = None,
    mask_meaning: str = "region",
    scale: str = "estimated",
    errors: str = "independent",
    effort: Effort | str = "balanced",
) -> FrustumFit:
    """Fit the ends and the two radii of a capped frustum to a depth image.

    The likelihood, the starts and the covariance are those of `fit_cylinder`, and so is
    what may be traced and differentiated. A cylinder is fitted as a frustum whose radii
    agree to within their deviations; `fit_cylinder(test_taper=True)` tells the two
    apart. The tip of a cone is an end that is not seen: the wall is reported as far as
    readings lie on it.

    Args:
        depth: (H, W), planar depth in meters; 0, NaN and infinity mean no reading.
        camera: The camera that took it.
        mask: (H, W), as in `fit_cylinder`.
        sigma: As in `fit_cylinder`.
        initial: Start of the fit, in the world frame; found from the image if None.
            It tells which end is p1.
        fixed: Names among center (the midpoint of the axis), axis, radius1, radius2 and
            height that keep the value they have in `initial`.
        prior: For any of these names, expected value and standard deviation in the
            world frame, in meters and (for the axis) radians; for radius1 and radius2
            with `initial` only.
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
        FRUSTUM,
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
    assert isinstance(fit, FrustumFit)
    return fit
