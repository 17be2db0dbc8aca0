"""Fit a sphere to a depth image."""

__all__ = ["fit_sphere"]

from typing import Any, Unpack

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.fittable import SPHERE
from impostor_jax.fit.options import FitOptions, Options
from impostor_jax.fit.result import Fit
from impostor_jax.fit.shapes import fit_shape
from impostor_jax.primitives.sphere import Sphere


def fit_sphere(
    depth: Any,
    camera: PinholeCamera,
    mask: Any = None,
    sigma: Any = None,
    initial: Sphere | None = None,
    **options: Unpack[FitOptions],
) -> Fit:
    """Fit center and radius of a sphere to a depth image.

    The likelihood, the starts and the covariance are those of `fit_cylinder`, and so is
    what may be traced and differentiated.

    Args:
        depth: (H, W), planar depth in meters; 0, NaN and infinity mean no reading.
        camera: The camera that took it.
        mask: (H, W), as in `fit_cylinder`.
        sigma: As in `fit_cylinder`.
        initial: Start of the fit, in the world frame; found from the image if None.
        options: What `FitOptions` lists.

    Returns:
        The fit. A fit that failed says so in `status`, with infinite standard
        deviations.

    Raises:
        TypeError: As in `fit_cylinder`, like the next.
        ValueError: Likewise.
    """
    asked = Options.of(options)
    return fit_shape(SPHERE, depth, camera, mask, sigma, initial, asked)
