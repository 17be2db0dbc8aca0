"""Lists of an object's rays and readings, made of an image and a camera.

On the host by NumPy, in few sizes, so that no compiled program depends on the image; of
what is traced by the same functions with JAX's arrays.
"""

__all__ = ["lattice_of", "passed_by", "ray_list", "table_of"]

import functools
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.camera.ray_table import RayTable, Sight, directions_of, shows_image
from impostor_jax.fit.body import AbstractBody, Passing
from impostor_jax.fit.per_pixel import law_of, spread_of
from impostor_jax.fit.problem import (
    BLOCK,
    DepthImage,
    Lattice,
    Mask,
    Pixels,
    RayList,
    Table,
    sigma_of,
)
from impostor_jax.fit.regions import GENTLE, STEEP, jump_parts
from impostor_jax.fit.surface import cropped
from impostor_jax.fit.uncertainty import MAX_LAG
from impostor_jax.geometry.frames import unmoved
from impostor_jax.opencv import cv2
from impostor_jax.sensor.base import AbstractDepthNoise

MOST_AT_EDGE = 512
"""Most pixels at the object's edge that are looked at, spread over all of it."""

FEWEST_AT_EDGE = 128
"""The same beside few readings, an eighth of more."""

SPREAD = 64
"""Pixels along each side of the image that tell what a solution would hide."""

BORDER = 4
"""Pixels along rows and columns within which a reading lies beside a mask's border; two
of them may have been left out."""

RING = 2
"""Those of the outermost pixels of a mask, of which more are taken where readings are
thinned."""

MOST_MISSING = 8
"""Pixels without a reading, from the edge of a mask inwards or outwards, beyond which
the next reading tells where the object ends."""

CROSS = np.array([[0, 0, 0, -1, 1], [0, -1, 1, 0, 0]])[..., None]
"""Rows down and columns right to a pixel itself, left, right, above and below."""

Indices = Any
"""Of NumPy or JAX."""


def table_of(
    depth: DepthImage,
    mask: Mask,
    row: Indices,
    col: Indices,
    camera: Sight,
    noise: AbstractDepthNoise,
    correlated: bool = False,
    unsure: Mask | None = None,
    missing: Mask | None = None,
    feet: Float[np.ndarray, "h w"] | None = None,
    xp: ModuleType = np,
) -> Table:
    """What an image shows of an object.

    Args:
        depth: In meters; 0 where there is no reading.
        mask: Pixels of the object.
        row: Rows of the object's pixels, as `pixel_indices` orders them; one beyond the
            image only fills up.
        col: Columns of the object's pixels.
        camera: That took the image.
        noise: Of its readings.
        correlated: Whether the covariance allows for correlated residuals.
        unsure: Pixels of the object whose readings tell where it ends alone.
        missing: Pixels of the mask that the sensor did not read, if these may be beyond
            the object.
        feet: As of `Seen`.
        xp: NumPy, or `jax.numpy` of what is traced.
    """
    height, width = depth.shape
    own = row < height
    at_edge, beside = _at_border(mask, row, col, xp)
    at_edge = own & at_edge
    # A mask may go on past the object, and where it has no reading nothing says so.
    if missing is not None:
        misses = at_edge & _of_pixels(missing, row, col, xp)
        at_edge = at_edge & ~misses
        if xp is np:
            lost = row[misses], col[misses]
            at_edge |= _before_missing(missing, mask, *lost, row, col)
    edge_row, edge_col = _around_some(at_edge, row, col, xp)
    if missing is not None and xp is np:
        edge_row, edge_col = _past_missing(depth, mask, edge_row, edge_col)
    rows, cols = _all_over((height, width))
    all_rows = xp.concatenate([row, edge_row.ravel(), rows])
    all_cols = xp.concatenate([col, edge_col.ravel(), cols])
    rays = ray_list(depth, camera, all_rows, all_cols, noise, xp)
    wrong, mixed = _off(depth, camera, noise, edge_row, edge_col, xp)
    doubted = np.zeros(len(row), bool)
    if unsure is not None:
        doubted = _of_pixels(unsure, row, col, xp)
    left_out = [doubted, wrong.ravel(), mask[rows, cols]]
    rays = rays._replace(depth=xp.where(xp.concatenate(left_out), 0, rays.depth))
    dtype = rays.x.dtype
    is_image = shows_image(camera)
    return Table(
        rays=rays,
        inside=_of_pixels(mask, edge_row, edge_col, xp),
        mixed=mixed,
        foot=_of_feet(feet, edge_row, edge_col, xp).astype(dtype),
        row=row,
        col=col,
        beside=xp.where(own & is_image, beside, 0).astype(dtype),
        is_image=is_image,
        lattice=lattice_of(row, col, (height, width), xp) if correlated else None,
        num_blocks=xp.asarray(-(-(len(row) - xp.argmax(own)) // BLOCK), xp.int32),
        each=xp.asarray(height * width / SPREAD**2, dtype),
        pixel=xp.asarray(camera.spacing, dtype),
        camera_from_world=camera.camera_from_world or unmoved(dtype),
        noise=law_of(noise),
    )


def _of_feet(
    feet: Float[np.ndarray, "h w"] | None,
    row: Indices,
    col: Indices,
    xp: ModuleType,
) -> Indices:
    """The `foot` of `Table`; pixels are as `_around_some` has them."""
    if feet is None:
        return xp.full(row.shape[1:], -1.0)
    return _of_pixels(feet, row, col, xp).max(axis=0)


@functools.lru_cache(maxsize=64)
def _all_over(shape: tuple[int, int]) -> tuple[Indices, Indices]:
    """Rows and columns of pixels all over an image."""
    sides = (np.linspace(0, n - 1, SPREAD).astype(int) for n in shape)
    rows, cols = np.meshgrid(*sides, indexing="ij")
    return rows.ravel(), cols.ravel()


def ray_list(
    depth: DepthImage,
    camera: Sight,
    row: Indices,
    col: Indices,
    noise: AbstractDepthNoise,
    xp: ModuleType = np,
) -> RayList:
    """What an image holds at some pixels; beyond it there is no reading.

    Args:
        depth: In meters; 0 where there is no reading.
        camera: That took the image.
        row: Rows of the pixels.
        col: Their columns.
        noise: Of its readings.
        xp: As of `table_of`.
    """
    exists = _exists(depth, row, col)
    row, col = xp.where(exists, row, 0), xp.where(exists, col, 0)
    dtype = jax.dtypes.canonicalize_dtype(float)
    start, length = None, xp.ones(row.shape, dtype)
    if xp is np:
        x, y = directions_of(camera, row, col, dtype)
    else:
        direction = camera.rays(row, col, dtype).direction
        x, y = direction.x, direction.y
    if isinstance(camera, RayTable):
        length = xp.sqrt(1 + x * x + y * y)
        if camera.start is not None:
            start = xp.asarray(camera.start)[row, col].astype(dtype)
    read = xp.where(exists, _at(depth, row, col), 0).astype(dtype)
    return RayList(x, y, read, exists, length, start, spread_of(noise, row, col, xp))


def passed_by(
    rays: RayList, body: AbstractBody, noise: AbstractDepthNoise
) -> tuple[Pixels, Passing, Bool[Array, " n"], Float[Array, " n"]]:
    """What a list holds, how its rays pass a body, which read, and their deviations."""
    pixels = rays.pixels()
    seen = body.passing(pixels.rays, body.radius / 100)
    read = pixels.depth > 0
    near = jnp.where(read, pixels.depth, 1)
    return pixels, seen, read, sigma_of(noise, pixels, near, seen.cos_incidence)


def _at_border(
    mask: Any, row: Indices, col: Indices, xp: ModuleType
) -> tuple[Indices, Indices]:
    """Which pixels of a mask are at its edge, and the `beside` of `Table`."""
    if xp is np:
        # In a part of the time of the whole image.
        box = cropped(mask, margin=BORDER)
        mask, row, col = mask[box], row - box[0].start, col - box[1].start
    inside, inner, core = (_eroded(mask, reach, xp) for reach in (1, RING, BORDER))
    parts = [~inside, mask & ~inner, inner & ~core]
    # All in one image of bits: each lookup takes as long as all of them.
    bits = sum(part.astype(np.uint8) << k for k, part in enumerate(parts))
    told = _of_pixels(bits, row, col, xp)
    at_edge, *rings = (told & (1 << k) > 0 for k in range(len(parts)))
    beside = xp.zeros(row.shape)
    for part, own in zip(parts[1:], rings, strict=True):
        stands_for = xp.count_nonzero(part) / xp.maximum(xp.count_nonzero(own), 1)
        beside = xp.where(own, stands_for, beside)
    return at_edge, beside


def _around_some(
    at_edge: Indices, row: Indices, col: Indices, xp: ModuleType
) -> tuple[Indices, Indices]:
    """Rows and columns of pixels at the edge, and of their neighbors.

    Rows of -1 only fill up.
    """
    count = min(MOST_AT_EDGE, max(FEWEST_AT_EDGE, len(row) // 8))
    if xp is np:
        (found,) = np.nonzero(at_edge)
        order = np.argsort(-_shuffle(len(row))[found])
        chosen = np.zeros(count, int)
        chosen[: len(found)] = found[order[:count]]
        is_some = np.arange(count) < len(found)
    else:
        priority = jnp.where(at_edge, _shuffle(len(row)), 0)
        priority, chosen = jax.lax.top_k(priority, count)
        is_some = priority > 0
    down, right = CROSS
    row, col = row[chosen][None] + down, col[chosen][None] + right
    return xp.where(is_some[None], row, -1), col


def _before_missing(
    missing: Mask,
    mask: Mask,
    edge_row: Indices,
    edge_col: Indices,
    row: Indices,
    col: Indices,
) -> Indices:
    """Which pixels of an object are the last that read before those at its edge.

    Args:
        missing: Pixels that the sensor did not read.
        mask: Pixels of the object.
        edge_row: Rows of those at its edge, without a reading.
        edge_col: Their columns.
        row: Rows of the object's pixels; one beyond the image only fills up.
        col: Their columns.
    """
    last = np.zeros_like(mask)
    for down, right in CROSS.T[0, 1:]:
        r, c = edge_row, edge_col
        ends = _exists(mask, r + down, c + right)
        ends &= ~_of_pixels(mask, r + down, c + right, np)
        r, c = r[ends], c[ends]
        for _ in range(MOST_MISSING):
            r, c = r - down, c - right
            within = _exists(missing, r, c)
            r, c = r[within], c[within]
            reads = ~missing[r, c]
            last[r[reads], c[reads]] = True
            r, c = r[~reads], c[~reads]
    return (row < len(mask)) & _of_pixels(last & mask, row, col, np)


def _past_missing(
    depth: DepthImage, mask: Mask, row: Indices, col: Indices
) -> tuple[Indices, Indices]:
    """Pixels and, in place of neighbors without a reading, the next outside with one.

    The object ends in between, of which more is not known. The pixels are as
    `_around_some` has them.
    """
    down, right = CROSS
    next_row, next_col = row, col
    for _ in range(MOST_MISSING):
        misses = _exists(depth, next_row, next_col)
        misses &= _of_pixels(depth, next_row, next_col, np) == 0
        next_row, next_col = next_row + misses * down, next_col + misses * right
    tells = _exists(depth, next_row, next_col) & (row[:1] >= 0)
    tells &= ~_of_pixels(mask, next_row, next_col, np)
    tells &= _of_pixels(depth, next_row, next_col, np) > 0
    return np.where(tells, next_row, row), np.where(tells, next_col, col)


def _off(
    depth: DepthImage,
    camera: Sight,
    noise: AbstractDepthNoise,
    row: Indices,
    col: Indices,
    xp: ModuleType,
) -> tuple[Indices, Indices]:
    """Which readings beside the object are neither its own nor of the next beyond.

    Of a sensor that is said to mix readings at edges none: that counts as it says. The
    pixels are as `_around_some` has them.

    Returns:
        Those beyond which the object goes on, which are wrong; and the others, the
        `mixed` of `Table`.
    """
    if noise.bias.errs_at_edges:
        return (xp.zeros(row.shape, bool),) * 2

    def read(row: Indices, col: Indices) -> Any:
        there = _exists(depth, row, col)
        return xp.where(there, _of_pixels(depth, row, col, xp), 0)

    here, (down, right) = read(row, col), CROSS
    own = here[:1]
    # Two, of which one may be an outlier. What is steep goes on as steeply.
    beyond = [read(row + k * down, col + k * right) for k in (1, 2)]
    noisy, width = jump_parts(here, camera, law_of(noise), xp)
    jump, step = noisy + STEEP * width, xp.abs(beyond[0] - beyond[1])
    is_surface = (beyond[0] > 0) & (beyond[1] > 0) & (step <= jump)
    slope = GENTLE * width + xp.where(is_surface, 2 * step, 0)
    # Where the object has no reading the other side alone tells.
    is_off = (xp.abs(here - own) > jump) | (own == 0)
    is_off &= (here > 0) & ((beyond[0] > 0) | (beyond[1] > 0))
    goes_on = xp.zeros(row.shape, bool)
    for k, other in enumerate(beyond, 1):
        is_off &= (xp.abs(here - other) > noisy + k * slope) | (other == 0)
        goes_on |= xp.abs(own - other) <= jump
    return is_off & goes_on, is_off & ~goes_on


@functools.cache
def _shuffle(size: int) -> Float[np.ndarray, " n"]:
    """Fixed priorities, so that the pixels that are kept lie all around the object."""
    return np.random.default_rng(0).uniform(0.5, 1, size).astype(np.float32)


def _exists(image: DepthImage | Mask, row: Indices, col: Indices) -> Indices:
    """Which pixels lie within an image."""
    height, width = image.shape
    return (row >= 0) & (row < height) & (col >= 0) & (col < width)


def _of_pixels(values: Any, row: Indices, col: Indices, xp: ModuleType) -> Any:
    """Values of pixels; beyond the image those of the nearest."""
    height, width = values.shape
    row = xp.minimum(xp.maximum(row, 0), height - 1)
    col = xp.minimum(xp.maximum(col, 0), width - 1)
    return _at(values, row, col)


def _at(values: Any, row: Indices, col: Indices) -> Any:
    """Values of pixels of an image."""
    return values.ravel()[row * values.shape[1] + col]


def _eroded(mask: Mask, reach: int, xp: ModuleType) -> Mask:
    """Pixels of a mask beside which, along rows and columns, all are so far.

    Beyond the image's border nothing is known to lie.
    """
    if xp is np:
        # In a tenth of the time, with what lies outside as it is by default: True.
        cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (2 * reach + 1,) * 2)
        return cv2.erode(np.asarray(mask).view(np.uint8), cross).view(bool)
    height, width = mask.shape
    padded = jnp.pad(mask, reach, constant_values=True)
    inner = mask
    for step in (*range(-reach, 0), *range(1, reach + 1)):
        first = reach + step
        inner = inner & padded[first : first + height, reach : reach + width]
        inner = inner & padded[reach : reach + height, first : first + width]
    return inner


def lattice_of(
    row: Indices, col: Indices, shape: tuple[int, int], xp: ModuleType = np
) -> Lattice:
    """Where pixels lie to each other.

    Args:
        row: Their rows; one beyond the image only fills up.
        col: Their columns.
        shape: Of the image.
        xp: As of `table_of`.
    """
    size, own = len(row), row < shape[0]
    height, width = shape
    if xp is np:
        # Only where pixels are, in few sizes.
        top, left = (int(place[own].min(initial=10**9)) for place in (row, col))
        row, col = row - top, col - left
        height, width = (int(place[own].max(initial=0)) + 1 for place in (row, col))
    # What is as far apart as a longest lag, along rows or beyond the end, is nothing.
    stride = width + MAX_LAG - 1
    places = (height + MAX_LAG) * stride
    if xp is np:
        places = next(size * 4**k for k in range(1, 20) if size * 4**k >= places)
    place = xp.where(own, row * stride + col, places)
    pixel_at = xp.full(places + 1, size, xp.int32)
    if xp is np:
        pixel_at[place] = np.arange(size)
        pixel_at[-1] = size
    else:
        pixel_at = pixel_at.at[place].set(jnp.arange(size), mode="drop")
        pixel_at = pixel_at.at[-1].set(size)
    return Lattice(pixel_at[:-1], place.astype(xp.int32), xp.asarray(stride, xp.int32))
