"""Fit a cylinder to a depth image."""

__all__ = ["fit_cylinder"]

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from impostor_jax.arguments import is_concrete
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.effort import Effort
from impostor_jax.fit.result import FitResult
from impostor_jax.fit.shapes import CYLINDER, fit_shape
from impostor_jax.fit.taper import taper_test
from impostor_jax.primitives.cylinder import Cylinder


def fit_cylinder(
    depth: Any,
    camera: PinholeCamera,
    mask: Any = None,
    sigma: Any = None,
    initial: Cylinder | None = None,
    fixed: Sequence[str] = (),
    prior: Mapping[str, Any] | None = None,
    mask_meaning: str = "region",
    scale: str = "estimated",
    errors: str = "independent",
    effort: Effort | str = "balanced",
    test_taper: bool = False,
) -> FitResult:
    """Fit center, axis, radius and height of a capped cylinder to a depth image.

    Inside `jax.jit` or `vmap` give `initial`: the first guess runs outside JAX. A
    traced fit without a mask uses the pixels that `initial` covers, and at most 16384
    readings.

    Args:
        depth: (H, W), planar depth in meters; 0, NaN and infinity mean no reading.
        camera: The camera that took it.
        mask: (H, W), True on pixels of the object, wall and caps together; or one
            integer there and 0 elsewhere. A label image is for `fit_labels`. Where
            the readings beside its border disagree with the others, it is cut down to
            what is of one surface; not so in a traced fit, which fails where many of
            them lie elsewhere.
            If None, the nearest large component that stands in front of its
            surroundings is taken, and reported as `region`.
        sigma: Standard deviation of a reading in meters, or a noise model of the
            sensor, which weighs each reading by its depth and incidence. Readings that
            scatter three times as much make it a `poor_fit`. If None, 1 mm weighs
            against priors and outlines, and is not held against the readings.
        initial: Start of the fit, in the world frame; found from the image if None.
        fixed: Names among center, axis, radius and height that keep the value they
            have in `initial`.
        prior: For any of these names, expected value and standard deviation in the
            world frame, in meters and (for the axis) radians.
        mask_meaning: "region": any subset of the object's pixels, its edge has no
            meaning; "outline": the edge is the object's silhouette, where no occluder
            stands in front of it.
        scale: Whether the width of the robust loss is "fixed" to deviations of the
            sensor or grows with the "estimated" spread of the residuals.
        errors: Whether readings err "independent" of each other, or "correlated"
            between neighboring pixels as those of real sensors do; decides which
            covariance is reported. Where the readings contradict independence, they
            are taken for correlated; in a traced fit only if that is said.
        effort: How much work it takes: "fast", "balanced" or "exact", or an `Effort`
            with a setting of each dial.
        test_taper: Whether to test, by the likelihood ratio, if a frustum is needed;
            `taper` of the result says so.

    Returns:
        The fit. A fit that failed says so in `status`, with infinite deviations.

    Raises:
        ValueError: An argument has a wrong shape, dtype or value, the mask is empty, or
            it holds fewer than 50 readings; or a taper is tested in a traced fit, or
            where the radius is fixed or expected.

    Derivatives:
        With `initial` given: of the cylinder in the depths, the camera and sigma, by
        the implicit function theorem at the solution.
    """
    asked = {
        "sigma": sigma,
        "fixed": fixed,
        "prior": prior,
        "mask_meaning": mask_meaning,
        "scale": scale,
        "errors": errors,
        "effort": effort,
    }
    if test_taper:
        _check_taper(asked, (depth, camera, mask, sigma, initial, prior))
    fit = fit_shape(CYLINDER, depth, camera, mask, initial=initial, **asked)
    assert isinstance(fit, FitResult)
    if not test_taper:
        return fit
    begin = fit.cylinder if fit.success else initial
    # The object that was taken is not looked for again.
    taken = fit.region if mask is None else mask
    taper = taper_test(depth, camera, taken, begin, asked)
    return dataclasses.replace(fit, taper=taper)


def _check_taper(asked: dict[str, Any], given: Any) -> None:
    """Raise where a taper cannot be tested."""
    names = {*asked["fixed"], *(asked["prior"] or {})}
    if "radius" in names:
        raise ValueError(
            "test_taper must be False where the radius is fixed or expected: a frustum "
            "has two"
        )
    if not is_concrete(given):
        raise ValueError("test_taper must be False in a traced fit, got True")
