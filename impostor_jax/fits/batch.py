"""Fit one cylinder to each of several depth images, side by side."""

__all__ = ["fit_cylinders"]

import math
from collections.abc import Sequence
from typing import Any, Unpack

import jax
import numpy as np

from impostor_jax.arguments import is_concrete, is_exact, unmasked
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.fit.batch import side_by_side
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.fit.options import FitOptions, Options
from impostor_jax.fit.request import check_types
from impostor_jax.fit.result import Asked, Fit, on_device
from impostor_jax.fits.shown import fit_or_failure
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.local_world import LocalWorld

ALIGNMENT = 64
"""Bytes to whose multiples XLA aligns what it computes with on processors."""


def fit_cylinders(
    depths: Any,
    camera: AbstractCamera | Sequence[AbstractCamera],
    masks: Any = None,
    sigma: Any = None,
    initial: Cylinder | None = None,
    **options: Unpack[FitOptions],
) -> Fit:
    """Fit one cylinder to each of several depth images, in as many threads as cores.

    Each fit is that of `fit_cylinder`, with a status of its own: an image that cannot
    be fitted fails alone, also one without readings or with an empty mask, whose status
    is `no_first_guess`. Inside `jax.jit` map `fit_cylinder` with `jax.vmap` instead.

    Args:
        depths: (N, H, W), as in `fit_cylinder`.
        camera: The camera of all images, or a list of N, one an image.
        masks: (N, H, W), or None.
        sigma: Of all images, as in `fit_cylinder`.
        initial: A batch (N,) of starts in the world frame; found from each image if
            None.
        options: What `FitOptions` lists.

    Returns:
        The fits, with a leading axis (N,) in every array. They can be indexed and
        iterated, and `statuses`, `reasons` and `to_dict()` are those of each.

    Raises:
        TypeError: As in `fit_cylinder`.
        ValueError: As in `fit_cylinder`, but for images with too few readings; or the
            numbers of images, cameras, masks and starts differ, or an argument is
            traced.
    """
    if not is_concrete((depths, masks, camera, sigma, initial, options)):
        raise ValueError(
            "depths, masks, camera and starts must be concrete, got traced ones; map "
            "fit_cylinder over them with jax.vmap"
        )
    depths = np.asarray(unmasked(depths))
    count = depths.shape[0] if depths.ndim == 3 else 0
    if not count:
        raise ValueError(f"depths must have the shape (N, H, W), got {depths.shape}")
    if masks is not None and len(masks) != count:
        raise ValueError(f"masks must be {count}, one an image, got {len(masks)}")
    cameras = list(camera) if isinstance(camera, list | tuple) else [camera] * count
    if len(cameras) != count:
        raise ValueError(f"camera must be one, or {count}, got {len(cameras)}")
    for one in cameras:
        check_types(Cylinder, one, initial, count)

    asked = Options.of(options)
    stacked: list[np.ndarray] = []
    exact: list[bool] = []
    each = [Asked()] * count
    # The farthest first, of whose types the others are stacked.
    order = sorted(range(count), key=lambda k: -_distance(cameras[k]))

    def fit(index: int) -> Any:
        mask = None if masks is None else masks[index]
        start = None if initial is None else jax.tree.map(lambda a: a[index], initial)
        found = fit_or_failure(
            CYLINDER, depths[index], cameras[index], mask, sigma, start, asked
        )
        each[index] = found.asked
        leaves, tree = jax.tree.flatten(found)
        if not stacked:
            # The first fit, which is made alone.
            stacked.extend(_aligned((count, *one.shape), one.dtype) for one in leaves)
            exact.extend(map(is_exact, leaves))
        # By NumPy, and at once: JAX would compile a program for each number of images,
        # in 0.5 s, and need fresh memory for the images of all fits, 0.3 ms each.
        for place, leaf in zip(stacked, leaves, strict=True):
            place[index] = leaf
        return tree

    tree = side_by_side(fit, order)[0]
    fits = tree.unflatten(on_device(stacked, exact))
    return fits.noting(each=tuple(each))


def _distance(camera: AbstractCamera) -> float:
    """From the origin, in meters, if its place is known in double precision."""
    world = LocalWorld.of([camera])
    return 0.0 if world is None else float(np.linalg.norm(world.place))


def _aligned(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Empty memory that JAX takes as it is; 0.6 ms an image if it had to copy."""
    size = math.prod(shape) * dtype.itemsize
    space = np.empty(size + ALIGNMENT, np.uint8)
    start = -space.ctypes.data % ALIGNMENT
    return space[start : start + size].view(dtype).reshape(shape)
