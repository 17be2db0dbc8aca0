"""Points as a caller gives them, checked: what fits and searches of clouds share."""

__all__ = [
    "GivenPoints",
    "as_numbers",
    "check_options",
    "level_of",
    "number_of",
    "points_given",
    "single_noise",
]

from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.arguments import described
from impostor_jax.effort import MIN_READINGS
from impostor_jax.fit.options import Options
from impostor_jax.fit.request import checked_noise
from impostor_jax.fits.grid import rounding_of
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.gaussian import ConstantNoise

MANY_ORIGINS = 33
"""Different origins from which on they may be something else: scanners are few, or move
by no whole numbers."""

UNIT_WITHIN = 0.01
"""Length, over 1, by which normals are off it in files of few digits."""

WHOLE_WITHIN = 0.02
"""Of a step of 255 by which colors are off a whole number of them, likewise."""


class GivenPoints(NamedTuple):
    """Points, and what is known of them.

    Attributes:
        ends: The points.
        starts: Where each was seen from; None where nobody tells.
        dtype: Floating-point type that they came in.
        rounding: Standard deviation of each coordinate by that, or by a file's grid.
        counts: Which are looked at.
    """

    ends: Float[np.ndarray, "n 3"]
    starts: Float[np.ndarray, "n 3"] | None
    dtype: np.dtype
    rounding: float
    counts: Bool[np.ndarray, " n"]


def points_given(points: Any, origin: Any) -> GivenPoints:
    """Points and what is known of them; the arguments are of `fit_cylinder_to_points`.

    Raises:
        ValueError: They have a wrong shape or value, or are fewer than 50.
    """
    ends, starts = _checked_points(points, origin)
    dtype = _type_of(points, ends)
    counts = np.ones(len(ends), bool)
    return GivenPoints(ends, starts, dtype, rounding_of(ends, dtype), counts)


def check_options(options: Options) -> None:
    """Raise where an option has no meaning for points."""
    if options.mask_meaning != "region":
        raise ValueError(
            f"mask_meaning must be 'region' for points, got {options.mask_meaning!r}: "
            "they have no outline"
        )
    if options.errors == "correlated":
        raise ValueError(
            "errors must be 'independent' for points, got 'correlated': they have no "
            "neighbors"
        )


def single_noise(sigma: Any) -> AbstractDepthNoise:
    """Noise of single readings: what pixels of an image share has no meaning."""
    noise = checked_noise(sigma)
    bias = noise.bias
    shares = bias.fields or bias.lean is not None
    if shares or bias.errs_at_edges:
        raise ValueError(
            "sigma must be a number or a noise model of single readings for points, "
            f"got {noise!r}, which says how pixels of an image err together"
        )
    return noise


def level_of(sigma: Any, given: GivenPoints) -> float | None:
    """Typical standard deviation of a point; None if nobody tells."""
    if sigma is None:
        return None
    noise = single_noise(sigma)
    reach = 1.0
    if given.starts is not None:
        reach = float(np.median(np.linalg.norm(given.ends - given.starts, axis=1)))
    return float(noise.sigma(jnp.asarray(reach), jnp.ones(())))


def number_of(sigma: Any) -> AbstractDepthNoise:
    """Noise of points without an origin: the same wherever they were seen from."""
    noise = single_noise(sigma)
    if not isinstance(noise, ConstantNoise):
        raise ValueError(
            "sigma must be a number, or ConstantNoise, for points without an origin, "
            f"got {noise!r}, which depends on where they were seen from"
        )
    return noise


def _checked_points(
    points: Any, origin: Any
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"] | None]:
    """Points and where each was seen from; None where nobody tells."""
    values = as_numbers("points", points)
    if values.ndim != 2 or values.shape[1] not in (3, 6):
        raise ValueError(f"points must be (N, 3) or (N, 6), got shape {values.shape}")
    if values.shape[1] == 6:
        if origin is not None:
            raise ValueError(
                "origin must not be given with points of shape (N, 6), which have one "
                "each"
            )
        ends, starts = values[:, :3], values[:, 3:]
        _check_origins(starts)
    elif origin is None:
        ends, starts = values, None
    else:
        place = as_numbers("origin", origin)
        if place.shape not in ((3,), values.shape):
            raise ValueError(
                f"origin must be (3,), or {values.shape}, one a point, got shape "
                f"{place.shape}"
            )
        ends, starts = values, np.broadcast_to(place, values.shape)
    if len(ends) < MIN_READINGS:
        raise ValueError(
            f"points must be at least {MIN_READINGS}, got {len(ends)} of them"
        )
    if starts is not None and np.any(np.all(ends == starts, axis=1)):
        raise ValueError("points must lie off the origin that they were seen from")
    return ends, starts


def _check_origins(starts: Float[np.ndarray, "n 3"]) -> None:
    """Raise where columns that should be origins are what files have beside points."""
    levels = starts if starts.max() > 1 else 255 * starts
    if np.all(np.abs(np.linalg.norm(starts, axis=1) - 1) < UNIT_WITHIN):
        what = "unit vectors, as of normals"
    elif (
        starts.min() >= 0
        and levels.max() <= 255
        and np.all(np.abs(levels - np.round(levels)) < WHOLE_WITHIN)
    ):
        what = "colors"
    else:
        return
    if len(np.unique(starts, axis=0)) < MANY_ORIGINS:
        return
    raise ValueError(
        "points must be (N, 3), or (N, 6) with the origin of each in columns 4 to 6, "
        f"got {what} there: give points[:, :3]"
    )


def as_numbers(
    name: str, value: Any, may_miss: bool = False
) -> Float[np.ndarray, "..."]:
    """An argument as numbers in double precision, or a clear error.

    They are finite, unless some `may_miss`.
    """
    if np.ma.is_masked(value):
        raise ValueError(
            f"{name} must hold no masked values, got {np.ma.count_masked(value)}: "
            "leave their rows out"
        )
    try:
        values = np.asarray(value, np.float64)
    except (TypeError, ValueError) as error:
        hint = ": ij.read_points reads a file" if isinstance(value, str | Path) else ""
        raise ValueError(
            f"{name} must be numbers, got {described(value)}{hint}"
        ) from error
    if may_miss:
        return values
    bad = np.count_nonzero(~np.all(np.isfinite(np.atleast_2d(values)), axis=-1))
    if bad:
        where = f" in {bad} of {len(values)} rows: leave these out" * (values.ndim > 1)
        raise ValueError(f"{name} must be finite, got NaN or infinity{where}")
    return values


def _type_of(points: Any, ends: Float[np.ndarray, "n 3"]) -> np.dtype:
    """Floating-point type that points came in, or that the file did they are from.

    Args:
        points: As they were given.
        ends: The same in double precision.
    """
    given = np.asarray(points).dtype
    if not np.issubdtype(given, np.floating):
        given = np.dtype(np.float64)
    # What reads a file may widen what that holds.
    is_single = given.itemsize > 4 and np.array_equal(ends, ends.astype(np.float32))
    return np.dtype(np.float32) if is_single else given
