"""Fit one cylinder to each of several depth images, side by side."""

__all__ = ["fit_cylinders"]

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np

from impostor_jax.arguments import is_concrete, is_exact, unmasked, unread
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.device import on_processor
from impostor_jax.effort import Effort, effort_of
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.fit.options import Errors, MaskMeaning, Options, Scale
from impostor_jax.fit.pixelwise import alike
from impostor_jax.fit.request import FitRequest, ReadingsError, check_types
from impostor_jax.fit.result import Fit, on_device
from impostor_jax.fit.threads import side_by_side
from impostor_jax.fits.shown import failure_of, fit_or_failure
from impostor_jax.primitives.cylinder import Cylinder


@on_processor
def fit_cylinders(
    depths: Any,
    camera: AbstractCamera | Sequence[AbstractCamera],
    masks: Any = None,
    sigma: Any = None,
    initial: Cylinder | None = None,
    *,
    fixed: Sequence[str] = (),
    prior: Mapping[str, Any] | None = None,
    mask_meaning: MaskMeaning = "region",
    scale: Scale = "estimated",
    errors: Errors | None = None,
    effort: Effort | str = "balanced",
) -> Fit:
    """Fit one cylinder to each of several depth images, in as many threads as cores.

    Each fit is that of `fit_cylinder`, with a status of its own: an image that cannot
    be fitted fails alone, also one without readings, with negative ones or with an
    empty mask, whose status is `no_first_guess` and whose `reason` says it. Inside
    `jax.jit` map `fit_cylinder` with `jax.vmap` instead.

    Args:
        depths: (N, H, W), as in `fit_cylinder`.
        camera: The camera of all images, or a list of N, one an image.
        masks: (N, H, W), or None.
        sigma: Of all images, as in `fit_cylinder`; or a list of N, one an image; or (N,
            H, W), of each reading.
        initial: A batch (N,) of starts in the world frame; found from each image if
            None.
        fixed: Names of parameters that keep their value in `initial`, as in
            `fit_cylinder`; none by default.
        prior: Expected value and standard deviation of parameters by name, in meters
            and radians, as in `fit_cylinder`; none by default.
        mask_meaning: "region" by default, or "outline", as in `fit_cylinder`.
        scale: "estimated" by default, or "fixed", as in `fit_cylinder`.
        errors: "independent" or "correlated"; what `sigma` says if None.
        effort: "fast", "balanced" (the default), "exact" or an `Effort`.

    Returns:
        The fits, with a leading axis (N,) in every array. They can be indexed and
        iterated, and `statuses`, `reasons` and `to_dict()` are those of each.

    Raises:
        ValueError: As in `fit_cylinder`, but for an image's readings; or the images
            differ in size, or the numbers of images, cameras, masks and starts do, or
            an argument is traced.
    """
    if not is_concrete((depths, masks, camera, sigma, initial, prior)):
        raise ValueError(
            "depths, masks, camera and starts must be concrete, got traced ones; map "
            "fit_cylinder over them with jax.vmap"
        )
    is_list = isinstance(depths, list | tuple)
    sizes = {np.shape(one) for one in depths} if is_list else set()
    if len(sizes) > 1:
        raise ValueError(
            f"depths must be of one size, got {sorted(sizes)}; fit those of each size "
            "by themselves, or each with fit_cylinder"
        )
    depths = np.asarray(unmasked(unread("depths", depths)))
    count = depths.shape[0] if depths.ndim == 3 else 0
    if not count:
        raise ValueError(f"depths must have the shape (N, H, W), got {depths.shape}")
    if masks is not None and (len(masks) != count or np.ndim(masks[0]) != 2):
        raise ValueError(
            f"masks must be {count} of shape (H, W), one an image, got {len(masks)} "
            f"of {np.shape(masks[0])}"
        )
    cameras = list(camera) if isinstance(camera, list | tuple) else [camera] * count
    if len(cameras) != count:
        raise ValueError(f"camera must be one, or {count}, got {len(cameras)}")
    for one in cameras:
        check_types(Cylinder, one, initial, count)

    told = isinstance(sigma, list | tuple)
    told |= isinstance(sigma, jax.Array | np.ndarray) and sigma.ndim == 3
    if told and len(sigma) != count:
        raise ValueError(f"sigma must be of {count} images, got {len(sigma)}")
    asked = Options(fixed, prior, mask_meaning, scale, errors, effort_of(effort))

    def fit(index: int) -> Fit:
        mask = None if masks is None else masks[index]
        start = None if initial is None else jax.tree.map(lambda a: a[index], initial)
        own = sigma[index] if told else sigma
        given = depths[index], cameras[index], mask, own
        request = FitRequest(CYLINDER, *given, start, asked)
        try:
            return fit_or_failure(request)
        except ReadingsError as error:
            return failure_of(request, error)

    return _stacked(side_by_side(fit, range(count)))


def _stacked(fits: Sequence[Fit]) -> Fit:
    """Several fits as one.

    By NumPy: JAX would compile a program for each number of fits.
    """
    told = alike([fit.pixelwise[0] for fit in fits])
    filled = [fit.having(pixelwise=(one,)) for fit, one in zip(fits, told, strict=True)]
    leaves, (tree, *_) = zip(*map(jax.tree.flatten, filled), strict=True)
    values = [*zip(*leaves, strict=True)]
    exact = [any(map(is_exact, parts)) for parts in values]
    stacked = [np.stack([*map(np.asarray, parts)]) for parts in values]
    together = tree.unflatten(on_device(stacked, exact))
    return together.noting(each=tuple(fit.asked for fit in fits))
