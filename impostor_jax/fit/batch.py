"""Fit one cylinder to each of several depth images, in one compiled call."""

__all__ = ["fit_cylinders"]

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from impostor_jax.arguments import is_concrete
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.assess import Start
from impostor_jax.fit.regions import (
    bucket,
    object_region,
    pixel_indices,
    some_pixels,
    surroundings,
)
from impostor_jax.fit.request import (
    check_types,
    checked_depth,
    checked_mask,
    checked_noise,
    checked_prior,
    checked_request,
)
from impostor_jax.fit.result import FitResult
from impostor_jax.fit.round_body import CylinderBody
from impostor_jax.fit.shapes import CYLINDER, no_guess, starts_of
from impostor_jax.fit.solve import NUM_KEPT, best_start, solve
from impostor_jax.primitives.cylinder import Cylinder


def fit_cylinders(
    depths: Any,
    camera: PinholeCamera,
    masks: Any = None,
    sigma: Any = 0.001,
    initial: Cylinder | None = None,
    fixed: Sequence[str] = (),
    prior: Mapping[str, Any] | None = None,
    mask_meaning: str = "region",
    kernel: str = "geman_mcclure",
    scale: str = "estimated",
    errors: str = "independent",
) -> FitResult:
    """Fit one cylinder to each of several depth images, in one compiled call.

    Each fit is that of `fit_cylinder`, with a status of its own: an image that cannot
    be fitted fails alone. Inside `jax.jit` map `fit_cylinder` with `jax.vmap` instead.

    Args:
        depths: (N, H, W), as in `fit_cylinder`.
        camera: The camera of all images.
        masks: (N, H, W), or None.
        sigma: Of all images, as in `fit_cylinder`.
        initial: A batch (N,) of starts in the world frame; found from each image if
            None.
        fixed: As in `fit_cylinder`.
        prior: Of all cylinders, as in `fit_cylinder`.
        mask_meaning: As in `fit_cylinder`.
        kernel: As in `fit_cylinder`.
        scale: As in `fit_cylinder`.
        errors: As in `fit_cylinder`.

    Returns:
        The fits, with a leading axis (N,) in every array.

    Raises:
        ValueError: As in `fit_cylinder`; or the numbers of images, masks and starts
            differ, or an argument is traced.
    """
    names = CYLINDER.parameters
    request = checked_request(
        Cylinder, names, fixed, initial, mask_meaning, kernel, scale, errors
    )
    noise, beliefs = checked_noise(sigma), checked_prior(prior, names, initial)
    if not is_concrete((depths, masks, camera, noise, initial, beliefs)):
        raise ValueError(
            "depths, masks, camera and starts must be concrete, got traced ones; map "
            "fit_cylinder over them with jax.vmap"
        )
    depths = np.asarray(depths)
    count = depths.shape[0] if depths.ndim == 3 else 0
    if not count:
        raise ValueError(f"depths must have the shape (N, H, W), got {depths.shape}")
    if masks is not None and len(masks) != count:
        raise ValueError(f"masks must be {count}, one an image, got {len(masks)}")
    check_types(Cylinder, camera, initial, count)
    images = [np.asarray(checked_depth(depth, camera)) for depth in depths]
    given = [
        None if masks is None else checked_mask(m, camera)
        for m in (images if masks is None else masks)
    ]

    def prepare(image, mask):
        mask = None if mask is None else np.asarray(mask)
        region = object_region(image, mask, camera, noise)
        if initial is not None:
            return region, None, None
        starts = starts_of(CYLINDER, image, region, camera, noise)
        return region, starts, (*some_pixels(region), *surroundings(region))

    # OpenCV and NumPy leave the other threads to run.
    with ThreadPoolExecutor() as pool:
        regions, starts, places = zip(*pool.map(prepare, images, given), strict=True)
    size = bucket(max(int(np.count_nonzero(region)) for region in regions))
    row, col = map(
        np.stack, zip(*(pixel_indices(r, size) for r in regions), strict=True)
    )
    mapped = (np.stack(images), np.stack(regions), row, col)
    shared = (camera, noise, beliefs)
    if initial is not None:
        begin = jax.vmap(partial(Start.at, count=NUM_KEPT))(CylinderBody.of(initial))
        return _solve_all(mapped, begin, shared, request, True)
    unguessed = [index for index, start in enumerate(starts) if start is None]
    if len(unguessed) == count:
        return _stacked([no_guess(CYLINDER, region) for region in regions])
    some = next(start for start in starts if start is not None)
    filled = _stacked([some if start is None else start for start in starts])
    places = tuple(map(np.stack, zip(*places, strict=True)))
    best = _best_starts(mapped[0], places, filled, shared, request.estimate_scale)
    fits = _solve_all(mapped, best, shared, request, False)
    for index in unguessed:
        failed = no_guess(CYLINDER, regions[index])
        fits = jax.tree.map(lambda all_, one: all_.at[index].set(one), fits, failed)  # noqa: B023
    return fits


def _stacked(trees: Sequence[Any]) -> Any:
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *trees)


@partial(jax.jit, static_argnames="estimate_scale")
def _best_starts(images, places, starts, shared, estimate_scale):
    def one(given):
        image, places, starts = given
        camera, noise, prior = shared
        return best_start(image, *places, camera, noise, starts, prior, estimate_scale)

    return jax.lax.map(one, (images, places, starts))


@partial(jax.jit, static_argnames="request")
def _solve_all(mapped, starts, shared, request, is_far):
    camera, noise, prior = shared

    def one(given):
        shown, start = given
        return solve(*shown, camera, noise, start, prior, request, is_far)

    # One after the other: side by side, each would wait for the slowest at every stage.
    return jax.lax.map(one, (mapped, starts))
