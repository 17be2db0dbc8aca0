"""First guesses of a body from its silhouette alone.

The rectangle around a silhouette has the body's direction in the image, or that across
it, its width, and a length that is the height's and the ends' together: how much of it
is whose depends on a tilt that nobody knows. So several are tried, towards the camera
and away from it. How far away the body is follows from what is known of its size.
"""

__all__ = ["guess_outlines"]

import dataclasses
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from impostor_jax.fit.body import AbstractBody
from impostor_jax.opencv import cv2

COSINES = (-0.95, -0.75, -0.4, -0.1, 0.1, 0.4, 0.75, 0.95)
"""Of the angle between axis and view, that are tried."""

MOST_SLENDER = 2.5
"""Length over width up to which the axis may be across the longer side: of a coin."""

LEAST_HEIGHT = 0.1
"""Of a guess, in radii."""


def guess_outlines(
    blank: AbstractBody, edge: Float[np.ndarray, "n 2"]
) -> list[AbstractBody]:
    """Bodies whose outlines are about that of a mask, one meter away in depth.

    Args:
        blank: A body of the kind that is fitted, without a size.
        edge: Where the edge of the mask is, in the plane z = 1.
    """
    # In single precision the square of a small angle would lose its digits.
    scale = float(np.ptp(edge, axis=0).max())
    middle = edge.mean(axis=0)
    near = ((edge - middle) / scale).astype(np.float32)
    (x, y), sides, degrees = cv2.minAreaRect(near)
    center = np.array([*(middle + scale * np.array([x, y])), 1.0])
    turn = np.radians(degrees)
    along = np.array([np.cos(turn), np.sin(turn)])
    ways = [(along, *sides), (np.array([-along[1], along[0]]), *sides[::-1])]
    if not blank.ends:
        return [_made(blank, center=center, radius=scale * sum(sides) / 4)]
    found = [
        _lying(blank, center, way, scale * length, scale * width, cosine)
        for way, length, width in ways
        for cosine in COSINES
        if width < MOST_SLENDER * length
    ]
    return [one for one in found if one is not None]


def _lying(
    blank: AbstractBody,
    center: Float[np.ndarray, "3"],
    way: Float[np.ndarray, "2"],
    length: float,
    width: float,
    cosine: float,
) -> AbstractBody | None:
    """A body whose axis goes one way in the image, and is tilted; None where none is.

    Along that way the silhouette has its length; the cosine is that of the angle
    between axis and view.
    """
    sight = center / np.linalg.norm(center)
    across = np.array([*way, 0.0])
    across = across - sight * (sight @ across)
    across /= np.linalg.norm(across)
    sine, radius = np.sqrt(1 - cosine**2), width / 2
    height = (length - width * abs(cosine)) / sine
    if height < LEAST_HEIGHT * radius:
        return None
    axis = sine * across + cosine * sight
    return _made(blank, center=center, axis=axis, radius=radius, height=height)


def _made(blank: AbstractBody, **values: Any) -> AbstractBody:
    """The blank body with other values of some fields."""
    dtype = blank.radius.dtype
    arrays = {name: np.asarray(value, dtype) for name, value in values.items()}
    return dataclasses.replace(blank, **jax.device_put(arrays))
