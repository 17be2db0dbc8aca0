"""Fit one cylinder to each of several depth images, side by side."""

__all__ = ["fit_cylinders"]

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from impostor_jax.arguments import is_concrete
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.effort import Effort
from impostor_jax.fit.cylinder import fit_cylinder
from impostor_jax.fit.request import check_types
from impostor_jax.fit.result import FitResult
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
    scale: str = "estimated",
    errors: str = "independent",
    effort: Effort | str = "balanced",
) -> FitResult:
    """Fit one cylinder to each of several depth images, in as many threads as cores.

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
        scale: As in `fit_cylinder`.
        errors: As in `fit_cylinder`.
        effort: As in `fit_cylinder`.

    Returns:
        The fits, with a leading axis (N,) in every array.

    Raises:
        ValueError: As in `fit_cylinder`; or the numbers of images, masks and starts
            differ, or an argument is traced.
    """
    if not is_concrete((depths, masks, camera, sigma, initial, prior)):
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

    def fit(index: int) -> FitResult:
        with jax.enable_x64(is_double):
            return fit_cylinder(
                depths[index],
                camera,
                None if masks is None else masks[index],
                sigma,
                None if initial is None else jax.tree.map(lambda a: a[index], initial),
                fixed,
                prior,
                mask_meaning,
                scale,
                errors,
                effort,
            )

    # A precision that the caller's thread has set is not that of another one.
    is_double = jnp.result_type(float) == np.float64
    # The first alone, which compiles for all.
    first = fit(0)
    with ThreadPoolExecutor() as pool:
        fits = [first, *pool.map(fit, range(1, count))]
    # In the precision of the fits, which is the effort's.
    with jax.enable_x64(first.rms.dtype == np.float64):
        return jax.tree.map(lambda *leaves: jnp.stack(leaves), *fits)
