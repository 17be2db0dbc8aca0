"""Fit each object of a label image."""

__all__ = ["fit_labels"]

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from impostor_jax.arguments import is_concrete, unmasked, unread
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.device import on_processor
from impostor_jax.effort import Effort, effort_of
from impostor_jax.fit.fittable import BOX, CYLINDER, FRUSTUM, SPHERE, TUBE
from impostor_jax.fit.options import Errors, MaskMeaning, Options, Scale
from impostor_jax.fit.request import FitRequest
from impostor_jax.fit.result import Fit
from impostor_jax.fit.threads import side_by_side
from impostor_jax.fits.shown import fit_or_failure
from impostor_jax.fits.single import (
    fit_box,
    fit_cylinder,
    fit_frustum,
    fit_sphere,
    fit_tube,
)
from impostor_jax.primitives.base import AbstractPrimitive

KIND_OF = {
    fit_cylinder: CYLINDER,
    fit_frustum: FRUSTUM,
    fit_sphere: SPHERE,
    fit_tube: TUBE,
    fit_box: BOX,
}


@on_processor
def fit_labels(
    depth: Any,
    camera: Any,
    labels: Any,
    fit: Callable[..., Fit] = fit_cylinder,
    sigma: Any = None,
    initial: AbstractPrimitive | None = None,
    *,
    fixed: Sequence[str] = (),
    prior: Mapping[str, Any] | None = None,
    mask_meaning: MaskMeaning = "region",
    scale: Scale = "estimated",
    errors: Errors | None = None,
    effort: Effort | str = "balanced",
) -> dict[int, Fit]:
    """Fit each object of a label image on its own, in as many threads as cores.

        fits = ij.fit_labels(depth, camera, labels, sigma=0.002)
        print(fits[3].cylinder, fits[3].status)

    An object that cannot be fitted fails alone: one with too few readings has the
    status `no_first_guess`. Without depth each label is an outline:

        fits = ij.fit_labels(None, camera, labels, mask_meaning="outline", prior=prior)

    Args:
        depth: (H, W), as in `fit_cylinder`; None where the labels are outlines.
        camera: The camera that took it.
        labels: (H, W), integers: 0 where there is no object, otherwise its number.
        fit: `fit_cylinder`, `fit_sphere`, `fit_frustum`, `fit_tube` or `fit_box`.
        sigma: Of all objects, as in `fit_cylinder`.
        initial: Start of all fits, as in `fit_cylinder`.
        fixed: Names of parameters that keep their value in `initial`, as in
            `fit_cylinder`; none by default.
        prior: Expected value and standard deviation of parameters by name, in meters
            and radians, as in `fit_cylinder`; none by default.
        mask_meaning: "region" by default, or "outline", as in `fit_cylinder`.
        scale: "estimated" by default, or "fixed", as in `fit_cylinder`.
        errors: "independent" or "correlated"; what `sigma` says if None.
        effort: "fast", "balanced" (the default), "exact" or an `Effort`.

    Returns:
        The fits by label, in ascending order.

    Raises:
        ValueError: As in `fit`; or the labels are no integers, or all 0, or there are
            several images, or something is traced.
    """
    if fit not in KIND_OF:
        names = ", ".join(known.__name__ for known in KIND_OF)
        raise ValueError(f"fit must be one of {names}; got {fit!r}")
    if not isinstance(camera, AbstractCamera):
        raise ValueError(
            "camera must be one camera, of the one label image, got "
            f"{type(camera).__name__}"
        )
    if isinstance(depth, list | tuple):
        raise ValueError(
            "depth must be one image, of the one label image, got "
            f"{type(depth).__name__}"
        )
    if not is_concrete((depth, labels, camera, sigma, initial, prior)):
        raise ValueError("depth, labels, camera and what is asked must be concrete, "
                         "got traced ones")  # fmt: skip
    numbers = np.asarray(unmasked(unread("labels", labels)))
    shape = (camera.height, camera.width)
    if numbers.shape != shape or not np.issubdtype(numbers.dtype, np.integer):
        raise ValueError(
            f"labels must be integers of the camera's shape {shape}, got "
            f"{numbers.dtype} of shape {numbers.shape}"
        )
    found = [int(label) for label in np.unique(numbers) if label != 0]
    if not found:
        raise ValueError("labels must hold at least one that is not 0, got none")
    kind = KIND_OF[fit]
    asked = Options(fixed, prior, mask_meaning, scale, errors, effort_of(effort))

    def fit_one(label: int) -> Fit:
        given = depth, camera, numbers == label, sigma
        return fit_or_failure(FitRequest(kind, *given, initial, asked))

    return dict(zip(found, side_by_side(fit_one, found), strict=True))
