"""Whether what was given as depth are distances along the rays.

Simulators and time-of-flight cameras know both, and files do not say which they hold.
Taken for depths, distances bend a plane towards the camera, by a tenth of the depth in
the corner of a common image, and make cylinders of a tenth more radius. What is flat in
the world tells: more of an image lies on planes if its values are what they are.
"""

__all__ = ["refuted_as_ranges", "warn_of_ranges"]

import itertools
import warnings
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.arguments import is_concrete, users_level
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.camera.ray_table import directions_of
from impostor_jax.fit.regions import DepthUnitsWarning
from impostor_jax.fit.request import Given, checked_depth
from impostor_jax.fit.result import Fit, is_sure

SIDE = 40
"""Rows and columns of an image that are looked at, at most."""

WINDOWS = 3
"""Windows along each side, half as large as the image, in each of which a plane is."""

TRIES = 48
"""Planes through three readings that are tried in each."""

OFF = 0.006
"""Part of its distance by which a reading may be off a plane."""

FEWEST = 60
"""Readings of a window that tell."""

LEAST_FLAT = 0.25
"""Part of the readings that must lie on planes."""

TIMES = 1.25
"""How many times as many must if they are distances: of six photographs 0.4 to 0.9 as
many do; of 60 drawn rooms that were given so 1.3 for a field of view of 40 degrees, and
2 to 4 for 60."""

ADVICE = (
    "depth must be measured along the camera's axis, and looks measured along the "
    "rays: {ranges:.0f} % of the image is flat if it was, {depths:.0f} % as it is; "
    "ij.depth_of_ranges(ranges, camera) turns it into depth"
)


def refuted_as_ranges(fit: Fit, views: Sequence[Given]) -> Fit:
    """The fit, or a failed one where an image that it doubts is of distances.

    Where no noise is told a fit doubts nothing: bent planes are noise that it measures.
    """
    if not is_concrete((fit, views)):
        return fit
    if is_sure(fit) and all(view.sigma is not None for view in views):
        return fit
    for view in views:
        said = _ranges_said(view.depth, view.camera)
        if said:
            return fit.contradicted(said + ".")
    return fit


def warn_of_ranges(depth: Float[np.ndarray, "h w"], camera: object) -> None:
    """Warn where an image is of distances."""
    said = _ranges_said(depth, camera)
    if said:
        warnings.warn(said, DepthUnitsWarning, stacklevel=users_level())


def _ranges_said(depth: object, camera: object) -> str | None:
    """What to say of an image of distances; None of one of depths."""
    if not isinstance(camera, PinholeCamera):
        return None
    image = np.asarray(checked_depth(depth, camera))
    step = max(1, -(-max(image.shape) // SIDE))
    row, col = np.meshgrid(
        *(np.arange(step // 2, size, step) for size in image.shape), indexing="ij"
    )
    read = image[row, col].astype(float)
    x, y = directions_of(camera, row, col, read.dtype)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    # A plane is linear in inverse depth.
    inverse = 1 / np.where(read > 0, read, 1)
    length = np.sqrt((rays**2).sum(axis=-1))
    random = np.random.default_rng(0)
    number = depths = ranges = 0
    starts = (np.linspace(0, size / 2, WINDOWS).astype(int) for size in read.shape)
    for top, left in itertools.product(*starts):
        window = np.zeros(read.shape, bool)
        window[top : top + len(read) // 2, left : left + read.shape[1] // 2] = True
        there = window & (read > 0)
        count = np.count_nonzero(there)
        if count < FEWEST:
            continue
        number += count
        chosen = random.integers(count, size=(TRIES, 3))
        for_all = rays[there], chosen
        depths += np.count_nonzero(_flattest(inverse[there], *for_all))
        ranges += np.count_nonzero(_flattest((inverse * length)[there], *for_all))
    if ranges < LEAST_FLAT * number or ranges <= TIMES * depths:
        return None
    return ADVICE.format(ranges=100 * ranges / number, depths=100 * depths / number)


def _flattest(
    inverse: Float[np.ndarray, " n"],
    rays: Float[np.ndarray, "n 3"],
    chosen: Int[np.ndarray, "k 3"],
) -> Bool[np.ndarray, " n"]:
    """Readings on that plane through a chosen three of them on which most lie."""
    corners = rays[chosen]
    apart = np.abs(np.linalg.det(corners)) > 1e-6
    if not apart.any():
        return np.zeros(len(inverse), bool)
    planes = np.linalg.solve(corners[apart], inverse[chosen[apart], None])[..., 0]
    near = np.abs(planes @ rays.T / inverse - 1) < OFF
    best = near[np.argmax(near.sum(axis=1))]
    rows = (rays / inverse[:, None])[best]
    plane = np.linalg.lstsq(rows, np.ones(len(rows)), rcond=None)[0]
    return np.abs(rays @ plane / inverse - 1) < OFF
