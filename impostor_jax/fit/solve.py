"""Fit a cylinder to a depth image.

Four steps: take the object's readings, guess a cylinder outside JAX, minimize the
whitened residuals with optimistix, and say how sure the result is. The last two are one
compiled function of arrays whose sizes come in powers of two, so that few are compiled.
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

from impostor_jax.arguments import is_concrete, one_of, real_number
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.initialize import first_guess
from impostor_jax.fit.parameterization import PARAMETERS, Chart
from impostor_jax.fit.residuals import (
    Rows,
    SurfaceSeen,
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
from impostor_jax.primitives.cylinder import Cylinder

MIN_READINGS = 50
"""A fit with fewer readings is refused."""

BUCKETS = tuple(size << k for k in range(14) for size in (2048, 3072))
"""Readings are filled up to one of these numbers, so that few sizes are compiled."""

TRACED_READINGS = 16384
"""Most readings that a traced fit uses, evenly spaced over its region."""

ROBUST_WIDTH = 2.0
"""Width of the pseudo-Huber loss, in standard deviations."""

DepthImage = Float[np.ndarray, "h w"] | Float[Array, "h w"]
Mask = Bool[np.ndarray, "h w"] | Bool[Array, "h w"]

STAGES = ((0.3, 0.1), (0.1, 0.1), (0.0, 0.01))
"""Blunting of the outline, in radii (at least one sigma), and tolerance of each stage.

A tolerance of 0.1 is one deviation. Convergence is nearly quadratic, so the last step,
of at most a tenth of a deviation, leaves much less.
"""

MIN_END_ROWS = 5
"""Fewest inlying readings of a cap, or crossings, that show an end."""

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
    fixed = _checked_fixed(fixed, initial)
    sigma = real_number("sigma", sigma, positive=True, unit="meters")
    _check_types(camera, initial)
    image = _checked_depth(depth, camera)
    given = _checked_mask(mask, camera)
    if not is_concrete((image, given, camera, sigma, initial)):
        if initial is None:
            raise ValueError(
                "initial must be given to a traced fit: the first guess runs outside "
                "JAX"
            )
        return _fit_traced(image, given, camera, sigma, initial, fixed)
    image, given = np.asarray(image), None if given is None else np.asarray(given)
    _check_readings(image, given)
    if given is None:
        footprint = 1 / min(float(camera.fx), float(camera.fy))
        given = nearest_object(image, float(sigma), footprint, MIN_READINGS)
    region = given & (image > 0)
    if camera.ray_field is not None:
        region &= np.isfinite(np.asarray(camera.ray_field.x))
    if initial is None:
        guess = first_guess(image, region, camera)
        if guess is None:
            return _no_guess(region)
        initial = Cylinder(guess.center, guess.axis, guess.radius, guess.height)
        if camera.camera_from_world is not None:
            initial = initial.transformed(camera.camera_from_world.inverse())
    rows, cols = np.nonzero(region)
    size = next(size for size in BUCKETS if size >= len(rows))
    # A row beyond the image only fills up.
    row, col = np.full(size, camera.height), np.zeros(size, int)
    row[: len(rows)], col[: len(rows)] = rows, cols
    return _fit(image, region, row, col, camera, sigma, initial, fixed)


def _checked_fixed(fixed: Sequence[str], initial: Cylinder | None) -> tuple[str, ...]:
    if isinstance(fixed, str):
        raise ValueError(f"fixed must be a sequence of names, got {fixed!r}")
    for name in fixed:
        one_of("fixed", name, PARAMETERS)
    if len(set(fixed)) == len(PARAMETERS):
        raise ValueError("fixed must leave a parameter to fit, got all four")
    if fixed and initial is None:
        raise ValueError(
            f"initial must be given with fixed={tuple(fixed)}: held parameters keep "
            "their value in it"
        )
    return tuple(name for name in PARAMETERS if name in fixed)


def _check_types(camera: PinholeCamera, initial: Cylinder | None) -> None:
    if not isinstance(camera, PinholeCamera):
        raise ValueError(f"camera must be a PinholeCamera, got {type(camera).__name__}")
    if initial is None:
        return
    if not isinstance(initial, Cylinder) or initial.radius.ndim:
        raise ValueError(f"initial must be one Cylinder, got {initial!r}")


def _checked_depth(depth: Any, camera: PinholeCamera) -> DepthImage:
    """Depth as a float image with 0 for missing readings."""
    if not isinstance(depth, jax.Array):
        depth = np.asarray(depth)
    shape = (camera.height, camera.width)
    if depth.shape != shape:
        raise ValueError(
            f"depth must have the camera's shape {shape}, got {depth.shape}"
        )
    if not jnp.issubdtype(depth.dtype, np.floating):
        raise ValueError(
            f"depth must be floating-point meters, got {depth.dtype}; multiply integer "
            "readings by their depth scale"
        )
    if is_concrete(depth):
        values = np.asarray(depth)
        values = np.where(np.isfinite(values), values, 0)
        if values.size and values.min() < 0:
            raise ValueError(
                f"depth must not be negative, got {values.min()} meters; missing "
                "readings are 0, NaN or infinity"
            )
        return values.astype(jnp.result_type(float))
    return jnp.where(jnp.isfinite(depth), depth, 0).astype(jnp.result_type(float))


def _checked_mask(mask: Any, camera: PinholeCamera) -> Mask | None:
    if mask is None:
        return None
    if not isinstance(mask, jax.Array):
        mask = np.asarray(mask)
    shape = (camera.height, camera.width)
    if mask.shape != shape:
        raise ValueError(f"mask must have the camera's shape {shape}, got {mask.shape}")
    if not (mask.dtype == bool or jnp.issubdtype(mask.dtype, np.integer)):
        raise ValueError(f"mask must be of booleans or integers, got {mask.dtype}")
    return mask != 0


def _check_readings(
    depth: Float[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"] | None
) -> None:
    if mask is not None and not mask.any():
        raise ValueError("mask must hold at least one pixel, got an empty one")
    count = np.count_nonzero(depth if mask is None else depth[mask])
    if count < MIN_READINGS:
        where = "" if mask is None else " inside the mask"
        raise ValueError(
            f"depth must hold at least {MIN_READINGS} readings{where}, got {count}"
        )


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
        in_camera = _in_camera(initial, camera)
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


def _in_camera(cylinder: Cylinder, camera: PinholeCamera) -> Cylinder:
    if camera.camera_from_world is None:
        return cylinder
    return cylinder.transformed(camera.camera_from_world)


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
        return image_rows(pixels, edge, sigma, _in_camera(cylinder, camera))

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

    seen = surface_seen(rows.ray, _in_camera(cylinder, camera), sigma)
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
    cylinder, ends_seen = _seen_extent(cylinder, rows, seen, believed)
    num_inliers = jnp.maximum(jnp.sum(inlier), 1).astype(dtype)
    rms = jnp.sqrt(jnp.sum(jnp.where(inlier, meters, 0) ** 2) / num_inliers)
    squares = jnp.sum(jnp.where(inlier, whitened, 0) ** 2)

    chart = Chart.around(cylinder, unit, fixed)
    in_camera = _in_camera(cylinder, camera)
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
    code = _status(
        converged=converged,
        finite=jnp.isfinite(cylinder.radius) & jnp.all(jnp.isfinite(cylinder.center)),
        fits=(2 * num_inliers >= count.astype(dtype))
        & ((scale < 5) | (scale * sigma < cylinder.radius / 20)),
        determined=(std.radius < cylinder.radius / 2)
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
        whitened = residuals(rows, _in_camera(chart.cylinder(vector), camera), soft)
        # A prior ten thousand deviations wide: the normal equations stay regular where
        # the image leaves a coordinate free.
        return pseudo_huber_residual(whitened, ROBUST_WIDTH), 1e-2 * vector

    solver = optx.LevenbergMarquardt(
        rtol=1e-5,
        atol=tolerance,
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


def _seen_extent(
    cylinder: Cylinder, rows: Rows, seen: SurfaceSeen, believed: Bool[Array, " n"]
) -> tuple[Cylinder, Bool[Array, "2"]]:
    """Tell which ends are seen, and draw an unseen one in to the last inlier.

    An end is seen through readings well inside its cap's disc, or where the wall gives
    way to background.
    """
    is_reading = rows.end == 0
    # Along the rim, wall and cap are not told apart by a noisy reading.
    on_cap = is_reading & seen.on_cap & (seen.cap_distance_squared < 0.9**2)
    shown = jnp.where(on_cap, seen.cap_end, rows.end)
    ends_seen = jnp.stack(
        [jnp.sum(believed & (shown == end)) >= MIN_END_ROWS for end in (-1, 1)]
    )
    on_wall = believed & is_reading & ~seen.on_cap
    half = cylinder.height / 2
    first = jnp.min(jnp.where(on_wall, seen.along, jnp.inf))
    last = jnp.max(jnp.where(on_wall, seen.along, -jnp.inf))
    low = jnp.where(ends_seen[0], -half, first)
    high = jnp.where(ends_seen[1], half, last)
    # Without a wall there is no extent to draw in to.
    empty = ~(jnp.isfinite(low) & jnp.isfinite(high) & (high > low))
    low, high = jnp.where(empty, -half, low), jnp.where(empty, half, high)
    center = cylinder.center + cylinder.axis * ((low + high) / 2)
    return (
        eqx.tree_at(lambda c: (c.center, c.height), cylinder, (center, high - low)),
        ends_seen,
    )


def _status(
    converged: Bool[Array, ""],
    finite: Bool[Array, ""],
    fits: Bool[Array, ""],
    determined: Bool[Array, ""],
) -> Int[Array, ""]:
    """Code of the first thing that went wrong."""
    code = {status: STATUSES.index(status) for status in FitStatus}
    return jnp.select(
        [~finite, ~converged, ~fits, ~determined],
        [
            jnp.array(code[FitStatus.NOT_FINITE]),
            jnp.array(code[FitStatus.STEP_LIMIT]),
            jnp.array(code[FitStatus.POOR_FIT]),
            jnp.array(code[FitStatus.UNDETERMINED]),
        ],
        jnp.array(code[FitStatus.CONVERGED]),
    )
