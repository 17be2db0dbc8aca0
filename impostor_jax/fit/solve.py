"""Fit a cylinder to a depth image.

Four steps: take the object's readings, guess a cylinder outside JAX, minimize the
whitened residuals with optimistix, and say how sure the result is. The last two are one
compiled function of arrays that come in few sizes.
"""

__all__ = ["fit_cylinder"]

from collections.abc import Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.arguments import is_concrete, real_number
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.assess import is_as_flat, seen_extent, status_code
from impostor_jax.fit.initialize import first_guesses
from impostor_jax.fit.parameterization import Chart
from impostor_jax.fit.request import (
    MIN_READINGS,
    DepthImage,
    Mask,
    check_readings,
    check_types,
    checked_depth,
    checked_fixed,
    checked_mask,
)
from impostor_jax.fit.residuals import (
    Rows,
    gather_pixels,
    image_rows,
    residual_gradient,
    residuals,
    surface_seen,
)
from impostor_jax.fit.result import STATUSES, Deviations, FitResult, FitStatus
from impostor_jax.fit.robust import pseudo_huber_residual
from impostor_jax.fit.segment import nearest_object
from impostor_jax.fit.uncertainty import deviations
from impostor_jax.primitives.base import in_camera_frame
from impostor_jax.primitives.cylinder import Cylinder

BUCKETS = tuple(size << k for k in range(14) for size in (2048, 3072))
"""Readings are filled up to one of these numbers, so that few sizes are compiled."""

TRACED_READINGS = 16384
"""Most readings that a traced fit uses, evenly spaced over its region."""

ROBUST_WIDTH = 2.0
"""Width of the pseudo-Huber loss, in standard deviations."""

STAGES = ((0.3, 0.1), (0.1, 0.1), (0.0, 0.01))
"""Blunting of the outline, in radii (at least one sigma), and tolerance of each stage.

A tolerance of 0.1 is one deviation. Convergence is nearly quadratic, so the last step,
of at most a tenth of a deviation, leaves much less.
"""

GOOD_RMS = 2.0
"""A fit whose residuals are larger, in sigmas, makes room for the next first guess."""

MAX_STEPS = 100
"""Step limit of the solver."""


def fit_cylinder(
    depth: Any,
    camera: PinholeCamera,
    mask: Any = None,
    sigma: Any = 0.001,
    initial: Cylinder | None = None,
    fixed: Sequence[str] = (),
) -> FitResult:
    """Fit center, axis, radius and height of a capped cylinder to a depth image.

    Inside `jax.jit` or `vmap` give `initial`: the first guess runs outside JAX. A
    traced fit without a mask uses the pixels that `initial` covers, and at most 16384
    readings.

    Args:
        depth: (H, W), planar depth in meters; 0, NaN and infinity mean no reading.
        camera: The camera that took it.
        mask: (H, W), True or nonzero on pixels of the object, wall and caps together;
            any subset of them will do, its edge has no meaning. If None, the nearest
            large component that stands in front of its surroundings is taken, and
            reported as `region`.
        sigma: Standard deviation of a reading along its ray's depth, in meters.
        initial: Start of the fit, in the world frame; found from the image if None.
        fixed: Names among center, axis, radius and height that keep the value they
            have in `initial`.

    Returns:
        The fit. A fit that failed says so in `status`, with infinite deviations.

    Raises:
        ValueError: An argument has a wrong shape, dtype or value, the mask is empty, or
            it holds fewer than 50 readings.
    """
    fixed = checked_fixed(fixed, initial)
    sigma = real_number("sigma", sigma, positive=True, unit="meters")
    check_types(camera, initial)
    image = checked_depth(depth, camera)
    given = checked_mask(mask, camera)
    if not is_concrete((image, given, camera, sigma, initial)):
        if initial is None:
            raise ValueError(
                "initial must be given to a traced fit: the first guess runs outside "
                "JAX"
            )
        return _fit_traced(image, given, camera, sigma, initial, fixed)
    image, given = np.asarray(image), None if given is None else np.asarray(given)
    check_readings(image, given)
    if given is None:
        footprint = 1 / min(float(camera.fx), float(camera.fy))
        given = nearest_object(image, float(sigma), footprint, MIN_READINGS)
    region = given & (image > 0)
    if camera.ray_field is not None:
        region &= np.isfinite(np.asarray(camera.ray_field.x))
    rows, cols = np.nonzero(region)
    size = next(size for size in BUCKETS if size >= len(rows))
    # A row beyond the image only fills up.
    row, col = np.full(size, camera.height), np.zeros(size, int)
    row[: len(rows)], col[: len(rows)] = rows, cols

    def fit_from(start: Cylinder) -> FitResult:
        return _fit(image, region, row, col, camera, sigma, start, fixed)

    if initial is not None:
        return fit_from(initial)
    best: FitResult | None = None
    for guess in first_guesses(image, region, camera):
        start = Cylinder(guess.center, guess.axis, guess.radius, guess.height)
        if camera.camera_from_world is not None:
            start = start.transformed(camera.camera_from_world.inverse())
        fit = fit_from(start)
        if best is None or _rank(fit) < _rank(best):
            best = fit
        if fit.success and float(fit.rms) < GOOD_RMS * float(sigma):
            break
    return _no_guess(region) if best is None else best


def _rank(fit: FitResult) -> tuple[bool, float]:
    """Order of fits to one image: successes first, then the smaller residuals."""
    return not bool(fit.success), float(fit.rms)


def _no_guess(region: Bool[np.ndarray, "h w"]) -> FitResult:
    """Result of a fit that could not start; its cylinder has no meaning."""
    dtype = jnp.result_type(float)
    nowhere = jnp.full(3, jnp.inf, dtype)
    cylinder = Cylinder((0, 0, 1), (0, 0, 1), 1, 1)
    cylinder = eqx.tree_at(
        lambda c: (c.center, c.radius, c.height),
        cylinder,
        (nowhere * 0, jnp.zeros((), dtype), jnp.zeros((), dtype)),
    )
    return FitResult(
        cylinder=cylinder,
        std=Deviations(nowhere, nowhere[:2], nowhere[:2], nowhere[0], nowhere[0]),
        success=jnp.array(False),
        status_code=jnp.array(STATUSES.index(FitStatus.NO_FIRST_GUESS)),
        num_steps=jnp.array(0),
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
    sigma: float | Float[Array, ""],
    initial: Cylinder,
    fixed: tuple[str, ...],
) -> FitResult:
    """Fit with sizes that do not depend on any value."""
    if mask is None:
        in_camera = in_camera_frame(initial, camera)
        ray = camera.rays(*camera.frame.pixels(), depth.dtype)
        mask = in_camera.intersect(ray).mask
    region = jnp.asarray(mask) & (depth > 0)
    sees = camera.sees(*camera.frame.pixels())
    if sees is not None:
        region &= sees
    size = min(region.size, TRACED_READINGS)
    rank = jnp.cumsum(region.reshape(-1))
    count = rank[-1]
    # The first pixel of each rank; ranks are spread out where there are too many.
    wanted = jnp.arange(size) * jnp.maximum(count, size) // size + 1
    index = jnp.searchsorted(rank, wanted, side="left")
    row, col = jnp.divmod(jnp.where(wanted <= count, index, region.size), camera.width)
    return _fit(depth, region, row, col, camera, sigma, initial, fixed)


@partial(jax.jit, static_argnames="fixed")
def _fit(
    depth: Float[Array, "h w"],
    region: Bool[Array, "h w"],
    row: Int[Array, " n"],
    col: Int[Array, " n"],
    camera: PinholeCamera,
    sigma: float | Float[Array, ""],
    initial: Cylinder,
    fixed: tuple[str, ...],
) -> FitResult:
    """Solve from `initial` over the given pixels; the others are not used."""
    dtype = initial.radius.dtype
    depth, sigma = depth.astype(dtype), jnp.asarray(sigma, dtype)
    pixels, edge = gather_pixels(depth, region, camera, row, col)
    used = pixels.exists
    count = jnp.sum(used)
    # Ten deviations of a position that this many readings share.
    unit = 10 * sigma / jnp.sqrt(jnp.maximum(count, 1).astype(dtype))

    def rows_at(cylinder: Cylinder) -> Rows:
        return image_rows(pixels, edge, sigma, in_camera_frame(cylinder, camera))

    def stage(carry: tuple[Cylinder, Rows, Array, Array], effort: Float[Array, "2"]):
        cylinder, _, _, num_steps = carry
        soft = jnp.maximum(effort[0] * initial.radius, sigma)
        rows, chart = rows_at(cylinder), Chart.around(cylinder, unit, fixed)
        vector, converged, steps = _minimize(chart, rows, camera, soft, effort[1])
        return (chart.cylinder(vector), rows, converged, num_steps + steps), None

    # While the outline still has pixels to cross, the square root that depth follows
    # there is blunted; otherwise each pixel is a kink that can stop the solver.
    blank = jax.tree.map(
        lambda field: jnp.zeros(field.shape, field.dtype),
        jax.eval_shape(rows_at, initial),
    )
    start = (initial, blank, jnp.array(False), jnp.array(0))
    (cylinder, rows, converged, num_steps), _ = jax.lax.scan(
        stage, start, jnp.array(STAGES, dtype)
    )
    cylinder, rows = _signed(cylinder, rows)

    seen = surface_seen(rows.direction, in_camera_frame(cylinder, camera), sigma)
    num_readings = used.shape[0]
    reading = rows.target[:num_readings]
    meters = jnp.where(used, reading - seen.depth[:num_readings], 0)
    whitened = jnp.abs(meters * rows.weight[:num_readings])
    ordered = jnp.sort(jnp.where(used, whitened, jnp.inf))
    scale = 1.4826 * ordered[jnp.maximum(count - 1, 0) // 2]
    inlier = used & (whitened <= 3 * jnp.maximum(scale, 1))
    # The residuals take a cap for a whole plane; readings beyond its rim are not on it.
    off_cap = seen.on_cap & (seen.cap_distance_squared > 1.1**2)
    inlier &= ~off_cap[:num_readings]
    past_end = jnp.abs(seen.along - rows.end * cylinder.height / 2) * rows.weight
    believed = jnp.concatenate(
        [inlier, (rows.weight[num_readings:] > 0) & (past_end[num_readings:] < 6)]
    )
    extent, ends_seen = seen_extent(cylinder, rows, seen, believed)
    if not {"center", "height"} & set(fixed):
        cylinder = extent
    num_inliers = jnp.maximum(jnp.sum(inlier), 1).astype(dtype)
    rms = jnp.sqrt(jnp.sum(jnp.where(inlier, meters, 0) ** 2) / num_inliers)
    squares = jnp.sum(jnp.where(inlier, whitened, 0) ** 2)

    chart = Chart.around(cylinder, unit, fixed)
    in_camera = in_camera_frame(cylinder, camera)
    tangent = chart.tangent()
    if camera.camera_from_world is not None:
        turn = camera.camera_from_world.rotate
        center_axis = [turn(tangent[:3].T).T, turn(tangent[3:6].T).T, tangent[6:]]
        tangent = jnp.concatenate(center_axis)
    gradient = residual_gradient(rows, in_camera, sigma)
    jacobian = jnp.matmul(gradient, tangent, precision="highest")
    std = deviations(
        chart,
        jnp.where(believed[:, None], jacobian, 0),
        fixed,
        ends_seen,
        widening=jnp.sqrt(jnp.maximum(squares / num_inliers, 1)),
    )
    code = status_code(
        converged=converged,
        finite=jnp.isfinite(cylinder.radius) & jnp.all(jnp.isfinite(cylinder.center)),
        fits=(2 * num_inliers >= count.astype(dtype))
        & ((scale < 5) | (scale * sigma < cylinder.radius / 50)),
        determined=~is_as_flat(rows, inlier, squares)
        & (std.radius < cylinder.radius / 2)
        & jnp.all(std.across_axis < cylinder.radius / 2)
        & jnp.all(std.axis < 0.5),
    )
    success = code == STATUSES.index(FitStatus.CONVERGED)

    def image_of(values: Array) -> Array:
        return (
            jnp.zeros(depth.shape, values.dtype).at[row, col].set(values, mode="drop")
        )

    return FitResult(
        cylinder=cylinder,
        std=jax.tree.map(lambda value: jnp.where(success, value, jnp.inf), std),
        success=success,
        status_code=code,
        num_steps=num_steps,
        residual=image_of(meters),
        inliers=image_of(inlier),
        region=image_of(used),
        ends_seen=ends_seen,
        num_pixels=count,
        rms=rms,
    )


def _minimize(
    chart: Chart,
    rows: Rows,
    camera: PinholeCamera,
    soft: Float[Array, ""],
    tolerance: Float[Array, ""],
) -> tuple[Float[Array, " n"], Bool[Array, ""], Int[Array, ""]]:
    """Levenberg-Marquardt in the chart's coordinates, from its reference."""

    def robust(vector: Float[Array, " n"], _: Any):
        whitened = residuals(
            rows, in_camera_frame(chart.cylinder(vector), camera), soft
        )
        # A prior three thousand deviations wide keeps the normal equations regular
        # where the image leaves a coordinate free.
        return pseudo_huber_residual(whitened, ROBUST_WIDTH), 3e-3 * vector

    solver = optx.LevenbergMarquardt(
        rtol=1e-5,
        # Only compared with: it may be traced.
        atol=tolerance,  # pyright: ignore[reportArgumentType]
        norm=optx.rms_norm,
        linear_solver=lx.Normal(lx.Cholesky()),
    )
    # On a GPU the default precision of a product is that of 10-bit mantissas.
    with jax.default_matmul_precision("highest"):
        solution = optx.least_squares(
            robust,
            solver,
            jnp.zeros(chart.size, soft.dtype),
            max_steps=MAX_STEPS,
            throw=False,
        )
    converged = solution.result == optx.RESULTS.successful
    return solution.value, converged, solution.stats["num_steps"]


def _signed(cylinder: Cylinder, rows: Rows) -> tuple[Cylinder, Rows]:
    """Turn the axis so that its largest component is positive, and the ends with it."""
    axis = cylinder.axis
    sign = jnp.where(axis[jnp.argmax(jnp.abs(axis))] < 0, -1, 1)
    return (
        eqx.tree_at(lambda c: c.axis, cylinder, axis * sign),
        eqx.tree_at(lambda r: r.end, rows, rows.end * sign),
    )
