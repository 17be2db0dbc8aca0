"""What a mask says of an outline: where its edge is, and how far that may be off.

A mask of booleans has a pixel where the pixel's center is in the silhouette, a matte
the part of each pixel that is covered; one of zeros and ones alone is of booleans,
whatever its type. Where either passes a half between two pixels is
its edge; only the pixels beside it tell of the outline. At the border of the image
there is no edge: what lies beyond says nothing.

Masks of people and of networks are wider or narrower than the object all along, and no
mask shows by how much: it would be of something larger, or nearer.
"""

__all__ = ["GRID_SIGMA", "Matte", "checked_matte"]

import dataclasses
import math
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.arguments import bounded_number, real_number, unmasked
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.camera.ray_table import has_rays
from impostor_jax.fit.regions import CROSS, SQUARE, small_holes
from impostor_jax.fit.request import TooFewReadingsError, checked_mask
from impostor_jax.opencv import cv2

USUAL_SIGMA = 0.05
"""Standard deviation of a matte's coverages that is taken where a caller names none."""

GRID_SIGMA = 12**-0.5
"""The same of a mask of booleans: the edge lies anywhere between two centers."""

EDGE_SIGMA = 0.5
"""Standard deviation, in pixels, by which an edge is off all along where a caller tells
nothing: masks that are a pixel too wide are common."""

FEWEST_PLACES = 20
"""Of an edge, that a fit needs."""


@dataclasses.dataclass(frozen=True)
class Matte:
    """A mask that was checked.

    Attributes:
        covered: Part of each pixel that is covered, in [0, 1].
        is_hard: Whether it tells of the pixels' centers alone.
        sigma: Standard deviation of a coverage.
        edge_sigma: Standard deviation, in pixels, by which its edge is off all along.
        is_trusted: Whether `sigma` is known, and not a guess.
        sees: Pixels of whose neighbors, too, the lens sees all.
    """

    covered: Float[np.ndarray, "h w"]
    is_hard: bool
    sigma: float
    edge_sigma: float
    is_trusted: bool
    sees: Bool[np.ndarray, "h w"]

    def edge(
        self,
    ) -> tuple[
        Int[np.ndarray, " n"],
        Int[np.ndarray, " n"],
        Float[np.ndarray, " n"],
        Float[np.ndarray, " n"],
    ]:
        """Places of the edge: rows and columns of pixels, and steps from their centers.

        One between any two neighbors of which one is in. The steps are along columns
        and rows, of less than a pixel.
        """
        found = []
        pairs = (0, 1, np.s_[:, :-1], np.s_[:, 1:]), (1, 0, np.s_[:-1], np.s_[1:])
        for down, right, first, second in pairs:
            low, high = self.covered[first], self.covered[second]
            crosses = (low >= 0.5) != (high >= 0.5)
            row, col = np.nonzero(crosses & self.sees[first] & self.sees[second])
            start, end = low[row, col], high[row, col]
            part = (0.5 - start) / (end - start)
            found.append((row, col, right * part, down * part))
        row, col, cols, rows = map(np.concatenate, zip(*found, strict=True))
        return row, col, cols, rows

    def beside(self) -> Bool[np.ndarray, "h w"]:
        """Pixels on both sides of the edge, and their neighbors along rows and columns.

        A straight edge crosses no others than the first; the second bring back an
        estimate that is off.
        """
        row, col, cols, rows = self.edge()
        edge = np.zeros(self.covered.shape, np.uint8)
        edge[row, col] = 1
        edge[row + (rows > 0), col + (cols > 0)] = 1
        return (cv2.dilate(edge, CROSS) > 0) & self.sees


def checked_matte(mask: Any, camera: PinholeCamera, sigma: Any) -> Matte:
    """A mask of booleans, integers or coverages, as a caller gives it; concrete.

    Raises:
        ValueError: It is none, has another shape or other values, or sigma is none of
            it.
    """
    if mask is None:
        raise ValueError(
            "mask must be given where depth is None: the silhouette is all there is"
        )
    values = np.asarray(unmasked(mask))
    is_hard = not np.issubdtype(values.dtype, np.floating)
    if is_hard:
        values = np.asarray(checked_mask(values, camera))
    else:
        shape = (camera.height, camera.width)
        if values.shape != shape:
            raise ValueError(
                f"mask must have the camera's shape {shape}, got {values.shape}"
            )
        low, high = values.min(), values.max()
        # NaN passes on.
        if not (low >= 0 and high <= 1):
            raise ValueError(
                "mask must hold coverages from 0 to 1 if it is of floats, got values "
                f"from {low} to {high}"
            )
        # Of the errors that are taken for a matte's, each pixel's its own, a mask that
        # is stored as floats has none: the fit would be up to 31 deviations off.
        is_hard = bool(np.all((values == 0) | (values == 1)))
    if is_hard:
        # No silhouette of what is fitted has any: they are of what is in front.
        values = (values > 0) | small_holes(values > 0)
    deviation, edge_sigma = GRID_SIGMA if is_hard else USUAL_SIGMA, EDGE_SIGMA
    if is_hard and sigma is not None:
        wanted = "pixels by which the edge of a mask of booleans may be off: 0 or"
        edge_sigma = float(bounded_number("sigma", sigma, f"{wanted} positive"))
        deviation = math.hypot(GRID_SIGMA, edge_sigma)
    elif sigma is not None:
        deviation = real_number("sigma", sigma, positive=True, unit="parts of a pixel")
        edge_sigma = 0.0
    sees = np.ones(values.shape, np.uint8)
    if camera.ray_field is not None:
        sees = cv2.erode(has_rays(camera).astype(np.uint8), SQUARE)
    matte = Matte(
        covered=values.astype(jax.dtypes.canonicalize_dtype(float)),
        is_hard=is_hard,
        sigma=float(deviation),
        edge_sigma=edge_sigma,
        is_trusted=is_hard or sigma is not None,
        sees=sees > 0,
    )
    count = len(matte.edge()[0])
    if count < FEWEST_PLACES:
        raise TooFewReadingsError(
            f"mask must have an edge of at least {FEWEST_PLACES} places in the image, "
            f"got {count}"
        )
    return matte
