"""Fit a cylinder to a depth image.

Four steps: take the object's readings, guess cylinders outside JAX, minimize the
whitened residuals with optimistix, and say how sure the result is. The last two are one
compiled function of arrays that come in few sizes.
"""

__all__ = [
    "bucket",
    "fit_cylinder",
    "no_guess",
    "object_region",
    "pixel_indices",
    "some_pixels",
    "starts_of",
    "surroundings",
]

import threading
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.arguments import is_concrete
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.assess import Start
from impostor_jax.fit.initialize import first_guesses
from impostor_jax.fit.prior import Prior
from impostor_jax.fit.request import (
    MIN_READINGS,
    DepthImage,
    Mask,
    Request,
    check_readings,
    check_types,
    checked_depth,
    checked_mask,
    checked_noise,
    checked_prior,
    checked_request,
)
from impostor_jax.fit.result import (
    STATUSES,
    Deviations,
    Directions,
    FitResult,
    FitStatus,
)
from impostor_jax.fit.segment import nearest_object
from impostor_jax.fit.solve import NUM_KEPT, START_READINGS, best_start, solve
from impostor_jax.primitives.base import in_camera_frame, in_world_frame
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.sensor.base import AbstractDepthNoise

BUCKETS = tuple(size << k for k in range(14) for size in (2048, 3072))
"""Readings are filled up to one of these numbers, so that few sizes are compiled."""

TRACED_READINGS = 16384
"""Most readings that a traced fit uses, evenly spaced over its region."""

NUM_STARTS = 8
"""First guesses that are solved; fewer are filled up by the best one."""


def fit_cylinder(
    depth: Any,
    camera: PinholeCamera,
    mask: Any = None,
    sigma: Any = 0.001,
    initial: Cylinder | None = None,
    fixed: Sequence[str] = (),
    prior: Mapping[str, Any] | None = None,
    mask_meaning: str = "region",
    kernel: str = "geman_mcclure",
    scale: str = "estimated",
    errors: str = "independent",
) -> FitResult:
    """Fit center, axis, radius and height of a capped cylinder to a depth image.

    Inside `jax.jit` or `vmap` give `initial`: the first guess runs outside JAX. A
    traced fit without a mask uses the pixels that `initial` covers, and at most 16384
    readings.

    Args:
        depth: (H, W), planar depth in meters; 0, NaN and infinity mean no reading.
        camera: The camera that took it.
        mask: (H, W), True or nonzero on pixels of the object, wall and caps together.
            If None, the nearest large component that stands in front of its
            surroundings is taken, and reported as `region`.
        sigma: Standard deviation of a reading in meters, or a noise model of the
            sensor, which weighs each reading by its depth and incidence.
        initial: Start of the fit, in the world frame; found from the image if None.
        fixed: Names among center, axis, radius and height that keep the value they
            have in `initial`.
        prior: For any of these names, expected value and standard deviation in the
            world frame, in meters and (for the axis) radians.
        mask_meaning: "region": any subset of the object's pixels, its edge has no
            meaning; "outline": the edge is the object's silhouette, where no occluder
            stands in front of it.
        kernel: Robust loss: "pseudo_huber", "cauchy" or "geman_mcclure".
        scale: Whether the width of that loss is "fixed" to deviations of the sensor or
            grows with the "estimated" spread of the residuals.
        errors: Whether readings err "independent" of each other, or "correlated"
            between neighboring pixels as those of real sensors do; decides which
            covariance is reported.

    Returns:
        The fit. A fit that failed says so in `status`, with infinite deviations.

    Raises:
        ValueError: An argument has a wrong shape, dtype or value, the mask is empty, or
            it holds fewer than 50 readings.

    Derivatives:
        With `initial` given: of the cylinder in the depths, the camera and sigma, by
        the implicit function theorem at the solution.
    """
    request = checked_request(fixed, initial, mask_meaning, kernel, scale, errors)
    noise = checked_noise(sigma)
    beliefs = checked_prior(prior)
    check_types(camera, initial)
    image = checked_depth(depth, camera)
    given = checked_mask(mask, camera)
    if not is_concrete((image, given, camera, noise, initial, beliefs)):
        if initial is None:
            raise ValueError(
                "initial must be given to a traced fit: the first guess runs outside "
                "JAX"
            )
        return _fit_traced(image, given, camera, noise, initial, beliefs, request)
    image, given = np.asarray(image), None if given is None else np.asarray(given)
    region = object_region(image, given, camera, noise)
    row, col = pixel_indices(region, bucket(int(np.count_nonzero(region))))
    shown = (image, region, row, col, camera, noise)
    if initial is not None:
        start = Start.at(initial, NUM_KEPT)
        return solve(*shown, start, beliefs, request, is_far=True)
    compiled = _compile_ahead(shown, beliefs, request)
    starts = starts_of(image, region, camera, noise)
    if starts is None:
        return no_guess(region)
    beside = surroundings(region)
    some = some_pixels(region)
    start = best_start(
        image, *some, *beside, camera, noise, starts, beliefs, request.estimate_scale
    )
    compiled.join()
    return solve(*shown, start, beliefs, request, is_far=False)


_ahead: dict[Any, threading.Thread] = {}


def _compile_ahead(
    shown: tuple[Any, ...], prior: Prior, request: Request
) -> threading.Thread:
    """Compile the last part of a fit while the first is still on its way.

    Only the first fit of its kind takes this time: on two cores it then waits for the
    longer of the two parts and not for their sum.
    """
    arrays, structure = jax.tree.flatten((shown, prior))
    shapes = tuple((np.shape(array), jnp.result_type(array)) for array in arrays)
    double = jnp.result_type(float) == np.float64
    key = (shapes, structure, request, double)
    if key not in _ahead:

        def run() -> None:
            kept = Start.at(Cylinder((0, 0, 1), (0, 0, 1), 1, 1), NUM_KEPT)
            solve.lower(*shown, kept, prior, request, is_far=False).compile()

        # A precision that the caller's thread has set is not that of another one.
        target = jax.enable_x64(True)(run) if double else run
        thread = threading.Thread(target=target)
        _ahead[key] = thread
        thread.start()
    return _ahead[key]


def object_region(
    image: Float[np.ndarray, "h w"],
    mask: Bool[np.ndarray, "h w"] | None,
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
) -> Bool[np.ndarray, "h w"]:
    """Pixels of the object, those that miss a reading included."""
    check_readings(image, mask)
    if mask is None:
        sigma = _typical_sigma(image, image > 0, noise)
        footprint = 1 / min(float(camera.fx), float(camera.fy))
        mask = nearest_object(image, sigma, footprint, MIN_READINGS)
    if camera.ray_field is not None:
        mask = mask & np.isfinite(np.asarray(camera.ray_field.x))
    return mask


def _typical_sigma(
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    noise: AbstractDepthNoise,
) -> float:
    """Deviation of the region's middle reading, seen face on, in meters."""
    readings = image[region & (image > 0)]
    if not len(readings):
        return float("inf")
    middle = jnp.asarray(np.median(readings))
    return float(noise.sigma(middle, jnp.ones((), middle.dtype)))


def bucket(count: int) -> int:
    """Number of entries that this many pixels are filled up to."""
    return next(size for size in BUCKETS if size >= count)


def pixel_indices(
    region: Bool[np.ndarray, "h w"], size: int
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Rows and columns of a region's pixels; a row beyond the image only fills up."""
    # On a whole image a tenth of the time of `np.nonzero`.
    index = np.flatnonzero(region)
    row, col = np.full(size, region.shape[0]), np.zeros(size, int)
    row[: len(index)], col[: len(index)] = np.divmod(index, region.shape[1])
    return row, col


def some_pixels(
    region: Bool[np.ndarray, "h w"],
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Rows and columns of pixels that are evenly spread over a region."""
    count = max(int(np.count_nonzero(region)), START_READINGS)
    row, col = pixel_indices(region, count)
    some = np.arange(START_READINGS) * count // START_READINGS
    return row[some], col[some]


def surroundings(
    region: Bool[np.ndarray, "h w"],
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Pixels around a region, evenly spread over half its size more on each side."""
    rows, cols = np.nonzero(region.any(axis=1))[0], np.nonzero(region.any(axis=0))[0]
    reach = (max(rows[-1] - rows[0], cols[-1] - cols[0]) + 2) // 2
    top, left = max(rows[0] - reach, 0), max(cols[0] - reach, 0)
    near = ~region[top : rows[-1] + reach + 1, left : cols[-1] + reach + 1]
    index = np.flatnonzero(near)
    some = np.linspace(0, len(index) - 1, START_READINGS).astype(int)
    if not len(index):
        return np.full(START_READINGS, region.shape[0]), np.zeros(START_READINGS, int)
    row, col = np.divmod(index[some], near.shape[1])
    return row + top, col + left


def starts_of(
    image: Float[np.ndarray, "h w"],
    region: Bool[np.ndarray, "h w"],
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
) -> Cylinder | None:
    """First guesses in the world, (NUM_STARTS,); None where there are none."""
    sigma = _typical_sigma(image, region, noise)
    guesses = first_guesses(image, region & (image > 0), camera, sigma)[:NUM_STARTS]
    if not guesses:
        return None
    guesses += [guesses[0]] * (NUM_STARTS - len(guesses))
    dtype = image.dtype
    starts = Cylinder(
        np.array([guess.center for guess in guesses], dtype),
        np.array([guess.axis for guess in guesses], dtype),
        np.array([guess.radius for guess in guesses], dtype),
        np.array([guess.height for guess in guesses], dtype),
    )
    return in_world_frame(starts, camera)


def no_guess(region: Bool[np.ndarray, "h w"]) -> FitResult:
    """Result of a fit that could not start; its cylinder has no meaning."""
    dtype = jnp.result_type(float)
    nowhere, zero = jnp.full(7, jnp.inf, dtype), jnp.zeros((), dtype)
    cylinder = eqx.tree_at(
        lambda c: (c.radius, c.height),
        Cylinder((0, 0, 0), (0, 0, 1), 1, 1),
        (zero, zero),
    )
    return FitResult(
        cylinder=cylinder,
        std=Deviations(nowhere[:3], nowhere[:2], nowhere[:2], nowhere[0], nowhere[0]),
        covariance=jnp.where(jnp.eye(7, dtype=bool), nowhere[0], zero),
        observed=Directions(jnp.zeros(7, bool), jnp.eye(7, dtype=dtype), nowhere),
        success=jnp.array(False),
        status_code=jnp.array(STATUSES.index(FitStatus.NO_FIRST_GUESS)),
        num_steps=jnp.array(0),
        num_starts=jnp.array(0),
        num_agreeing=jnp.array(0),
        residual=jnp.zeros(region.shape, dtype),
        inliers=jnp.zeros(region.shape, bool),
        region=jnp.asarray(region),
        ends_seen=jnp.zeros(2, bool),
        num_pixels=jnp.array(np.count_nonzero(region)),
        rms=jnp.array(jnp.inf, dtype),
    )


def _fit_traced(
    depth: DepthImage,
    mask: Mask | None,
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
    initial: Cylinder,
    prior: Prior,
    request: Request,
) -> FitResult:
    """Fit with sizes that do not depend on any value."""
    row, col = camera.frame.pixels()
    if mask is None:
        ray = camera.rays(row, col, depth.dtype)
        mask = in_camera_frame(initial, camera).intersect(ray).mask
    region = jnp.asarray(mask)
    sees = camera.sees(row, col)
    if sees is not None:
        region &= sees
    size = min(region.size, TRACED_READINGS)
    rank = jnp.cumsum(region.reshape(-1))
    count = rank[-1]
    # The first pixel of each rank; ranks are spread out where there are too many.
    wanted = jnp.arange(size) * jnp.maximum(count, size) // size + 1
    index = jnp.searchsorted(rank, wanted, side="left").astype(wanted.dtype)
    row, col = jnp.divmod(jnp.where(wanted <= count, index, region.size), camera.width)
    shown = (depth, region, row, col, camera, noise)
    return solve(*shown, Start.at(initial), prior, request, is_far=True)
