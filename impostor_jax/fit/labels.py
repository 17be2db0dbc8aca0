"""Fit each object of a label image."""

__all__ = ["fit_labels"]

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from impostor_jax.arguments import is_concrete
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.batch import fit_or_failure, side_by_side
from impostor_jax.fit.cylinder import fit_cylinder
from impostor_jax.fit.frustum import fit_frustum
from impostor_jax.fit.result import AbstractFit
from impostor_jax.fit.shapes import CYLINDER, FRUSTUM, SPHERE
from impostor_jax.fit.sphere import fit_sphere

KINDS = {fit_cylinder: CYLINDER, fit_frustum: FRUSTUM, fit_sphere: SPHERE}

Fitted = TypeVar("Fitted", bound=AbstractFit)


def fit_labels(
    depth: Any,
    camera: PinholeCamera,
    labels: Any,
    fit: Callable[..., Fitted] = fit_cylinder,
    **asked: Any,
) -> dict[int, Fitted]:
    """Fit each object of a label image on its own, in as many threads as cores.

        fits = ij.fit_labels(depth, camera, labels, sigma=0.002)
        print(fits[3].cylinder, fits[3].status)

    An object that cannot be fitted fails alone: one with too few readings has the
    status `no_first_guess`.

    Args:
        depth: (H, W), as in `fit_cylinder`.
        camera: The camera that took it.
        labels: (H, W), integers: 0 where there is no object, otherwise its number.
        fit: `fit_cylinder`, `fit_sphere` or `fit_frustum`.
        asked: What else it takes, for all objects.

    Returns:
        The fits by label, in ascending order.

    Raises:
        ValueError: As in `fit`; or the labels are no integers, or all 0, or something
            is traced.
    """
    if fit not in KINDS:
        names = ", ".join(known.__name__ for known in KINDS)
        raise ValueError(f"fit must be one of {names}; got {fit!r}")
    if not is_concrete((depth, labels, camera, asked)):
        raise ValueError("depth, labels, camera and what is asked must be concrete, "
                         "got traced ones")  # fmt: skip
    numbers = np.asarray(labels)
    shape = (camera.height, camera.width)
    if numbers.shape != shape or not np.issubdtype(numbers.dtype, np.integer):
        raise ValueError(
            f"labels must be integers of the camera's shape {shape}, got "
            f"{numbers.dtype} of shape {numbers.shape}"
        )
    found = [int(label) for label in np.unique(numbers) if label != 0]
    if not found:
        raise ValueError("labels must hold at least one that is not 0, got none")
    effort = asked.get("effort", "balanced")

    def fit_one(label: int) -> Fitted:
        mask = numbers == label
        return fit_or_failure(
            lambda: fit(depth, camera, mask, **asked),
            KINDS[fit], depth, camera, mask, effort,
        )  # fmt: skip

    return dict(zip(found, side_by_side(fit_one, found), strict=True))
