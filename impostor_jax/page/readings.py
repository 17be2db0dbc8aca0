"""The readings of depth images as points in space."""

__all__ = ["Readings", "points_of", "readings_of"]

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.page.shown import ImageView

MOST_READINGS = 100_000
"""That a page shows of an image: 2.7 MB, and 0.1 s a frame where no graphics card is.
"""


@dataclasses.dataclass(frozen=True)
class Readings:
    """Readings that a page shows of one image.

    Attributes:
        place: In the frame of the camera, in meters.
        residual: As of `ImageView`, in meters.
        owner: Number of the fit that used each, from 1; 0 where none did.
        footprint: Width of a pixel where the rays begin, and by how much more it is a
            meter farther, in meters.
    """

    place: Float[np.ndarray, "n 3"]
    residual: Float[np.ndarray, " n"]
    owner: Int[np.ndarray, " n"]
    footprint: tuple[float, float]


def readings_of(view: ImageView, most: int = MOST_READINGS) -> Readings:
    """Readings of an image: those of the fits, and as many others as there is room for.

    Args:
        view: The image.
        most: How many at most. Where there are more, every n-th row and column counts;
            at least a quarter is left to the rest.
    """
    valid, used = view.depth > 0, view.owner >= 0
    row, col = np.indices(view.depth.shape)
    is_seen = view.camera.sees(jnp.asarray(row), jnp.asarray(col))
    if is_seen is not None:
        valid = valid & np.asarray(is_seen)
    of_fits = _thinned(valid & used, most * 3 // 4)
    others = _thinned(valid & ~used, most - int(np.count_nonzero(of_fits)))
    rows, cols = np.nonzero(of_fits | others)
    return Readings(
        place=points_of(view, rows, cols),
        residual=view.residual[rows, cols],
        owner=view.owner[rows, cols] + 1,
        footprint=_footprint(view),
    )


def points_of(
    view: ImageView, rows: Int[np.ndarray, " n"], cols: Int[np.ndarray, " n"]
) -> Float[np.ndarray, "n 3"]:
    """Where readings are, in the frame of the camera, in meters."""
    origin, direction = _rays(view, rows, cols)
    return origin + view.depth[rows, cols, None] * direction


def _rays(
    view: ImageView, rows: Int[np.ndarray, " n"], cols: Int[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Where the rays of pixels begin, and how they go on with each meter of depth."""
    ray = view.camera.rays(jnp.asarray(rows), jnp.asarray(cols), jnp.result_type(float))
    origin, direction = (
        np.asarray(x.stack(), float) for x in (ray.origin, ray.direction)
    )
    return origin, direction


def _thinned(mask: Bool[np.ndarray, "h w"], most: int) -> Bool[np.ndarray, "h w"]:
    """Of every n-th row and column, with the smallest n that leaves so few pixels."""
    stride, kept = 1, mask
    while np.count_nonzero(kept) > most:
        stride += 1
        kept = np.zeros_like(mask)
        kept[::stride, ::stride] = mask[::stride, ::stride]
    return kept


def _footprint(view: ImageView) -> tuple[float, float]:
    """How wide the pixel in the middle of an image is, as of `Readings`."""
    height, width = view.depth.shape
    cols = np.minimum(width // 2 + np.arange(2), width - 1)
    origin, direction = _rays(view, np.full(2, height // 2), cols)
    apart = [float(np.linalg.norm(x[1] - x[0])) for x in (origin, direction)]
    return apart[0], apart[1] / float(np.linalg.norm(direction[0]))
