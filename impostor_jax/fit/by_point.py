"""What a fit to points tells, point by point.

Points are fitted as images of one row, of which each holds those that look one way.
"""

__all__ = ["told_by_point"]

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int

from impostor_jax.fit.result import Fit

OF_PIXELS = ("residual", "inliers", "region")
"""What a fit tells of each pixel."""


def told_by_point(fit: Fit, places: Sequence[Int[np.ndarray, "..."]]) -> Fit:
    """A fit to images of points, as one to the points.

    Args:
        fit: Of as many images as there are places.
        places: Which points the first pixels of each image are; all together are those
            that there are.
    """
    count = sum(len(place) for place in places)
    told = {}
    for name in OF_PIXELS:
        images = [np.asarray(image)[0] for image in jax.tree.leaves(getattr(fit, name))]
        values = np.zeros(count, images[0].dtype)
        for image, place in zip(images, places, strict=True):
            values[place] = image[: len(place)]
        told[name] = jnp.asarray(values)
    return dataclasses.replace(fit, source="points", **told)
