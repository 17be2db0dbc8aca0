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
    EndCrossings,
    Readings,
    depth_residual,
    end_residual,
    find_crossings,
    surface_seen,
    weigh,
)
from impostor_jax.fit.result import STATUSES, Deviations, FitResult, FitStatus
from impostor_jax.fit.robust import pseudo_huber_residual
from impostor_jax.fit.segment import nearest_object
from impostor_jax.fit.uncertainty import deviations
from impostor_jax.geometry.rays import Ray
from impostor_jax.primitives.cylinder import Cylinder

MIN_READINGS = 50
"""A fit with fewer readings is refused."""

SMALLEST_BUCKET = 4096
"""Readings are filled up to this number or the next power of two."""

TRACED_READINGS = 16384
"""Most readings that a traced fit uses, evenly spaced over its region."""

ROBUST_WIDTH = 2.0
"""Width of the pseudo-Huber loss, in standard deviations."""

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
        region &= np.asarray(camera.ray_field.valid)
    if initial is None:
        guess = first_guess(image, region, camera)
        if guess is None:
            return _no_guess(region)
        initial = Cylinder(guess.center, guess.axis, guess.radius, guess.height)
        if camera.camera_from_world is not None:
            initial = initial.transformed(camera.camera_from_world.inverse())
    rows = np.flatnonzero(region)
    bucket = SMALLEST_BUCKET
    while bucket < len(rows):
        bucket *= 2
    index = np.full(bucket, region.size)
    index[: len(rows)] = rows
    return _fit(image, region, index, camera, sigma, initial, fixed)


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


def _checked_depth(depth: Any, camera: PinholeCamera) -> Float[Array, "h w"]:
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


def _checked_mask(mask: Any, camera: PinholeCamera) -> Bool[Array, "h w"] | None:
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
    depth: Float[Array, "h w"],
    mask: Bool[Array, "h w"] | None,
    camera: PinholeCamera,
    sigma: float | Float[Array, ""],
    initial: Cylinder,
    fixed: tuple[str, ...],
) -> FitResult:
    """Fit with sizes that do not depend on any value."""
    if mask is None:
        in_camera = _in_camera(initial, camera)
        mask = in_camera.intersect(camera.rays(camera.frame, depth.dtype)).mask
    region = jnp.asarray(mask) & (depth > 0)
    valid = camera.valid_pixels(camera.frame)
    if valid is not None:
        region &= valid
    size = min(region.size, TRACED_READINGS)
    rank = jnp.cumsum(region.reshape(-1))
    count = rank[-1]
    # The first pixel of each rank; ranks are spread out where there are too many.
    wanted = jnp.arange(size) * jnp.maximum(count, size) // size + 1
    index = jnp.searchsorted(rank, wanted, side="left")
    index = jnp.where(wanted <= count, index, region.size)
    return _fit(depth, region, index, camera, sigma, initial, fixed)


def _in_camera(cylinder: Cylinder, camera: PinholeCamera) -> Cylinder:
    if camera.camera_from_world is None:
        return cylinder
    return cylinder.transformed(camera.camera_from_world)


@partial(jax.jit, static_argnames="fixed")
def _fit(
    depth: Float[Array, "h w"],
    region: Bool[Array, "h w"],
    index: Int[Array, " n"],
    camera: PinholeCamera,
    sigma: float | Float[Array, ""],
    initial: Cylinder,
    fixed: tuple[str, ...],
) -> FitResult:
    """Solve from `initial` over the pixels of `index`; the others are not used."""
    dtype = initial.radius.dtype
    depth, sigma = depth.astype(dtype), jnp.asarray(sigma, dtype)
    image_ray = camera.rays(camera.frame, dtype)
    used = index < depth.size
    pixel = jnp.where(used, index, 0)
    ray = jax.tree.map(lambda field: field.reshape(-1)[pixel], image_ray)
    start = _in_camera(initial, camera)
    values = depth.reshape(-1)[pixel]
    weight = weigh(values, used, sigma, surface_seen(ray, start))
    readings = Readings(ray=ray, depth=values, weight=weight)
    crossings = find_crossings(depth, region, image_ray, index, start, sigma)

    count = jnp.sum(used)
    # Ten deviations of a position that this many readings share.
    unit = 10 * sigma / jnp.sqrt(jnp.maximum(count, 1).astype(dtype))
    chart = Chart(reference=initial, unit=unit, fixed=fixed)
    vector, converged, finite, num_steps = _minimize(chart, readings, crossings, camera)
    cylinder = _signed(chart.cylinder(vector))
    flipped = jnp.sum(cylinder.axis * initial.axis) < 0
    crossings = eqx.tree_at(
        lambda c: c.end, crossings, jnp.where(flipped, -crossings.end, crossings.end)
    )

    residual = -depth_residual(readings, _in_camera(cylinder, camera))
    size = jnp.sort(jnp.where(used, jnp.abs(residual), jnp.inf))
    scale = 1.4826 * size[jnp.maximum(count - 1, 0) // 2]
    inlier = used & (jnp.abs(residual) <= 3 * jnp.maximum(scale, 1))
    cylinder, ends_seen = _seen_extent(
        cylinder, _in_camera(cylinder, camera), readings, crossings, inlier
    )

    chart = Chart(reference=cylinder, unit=unit, fixed=fixed)
    std = _uncertainty(chart, readings, crossings, camera, inlier, ends_seen)
    num_inliers = jnp.sum(inlier)
    meters = (values - surface_seen(ray, _in_camera(cylinder, camera)).depth) * used
    rms = jnp.sqrt(jnp.sum(jnp.where(inlier, meters, 0) ** 2) / num_inliers)
    code = _status(
        converged=converged,
        finite=finite & jnp.isfinite(cylinder.radius),
        fits=(2 * num_inliers >= count)
        & ((scale < 5) | (scale * sigma < cylinder.radius / 20)),
        determined=(std.radius < cylinder.radius / 2) & jnp.all(std.axis < 0.5),
    )
    success = code == STATUSES.index(FitStatus.CONVERGED)
    std = jax.tree.map(lambda value: jnp.where(success, value, jnp.inf), std)

    def image_of(rows: Array) -> Array:
        blank = jnp.zeros(depth.size, rows.dtype)
        return blank.at[index].set(rows, mode="drop").reshape(depth.shape)

    return FitResult(
        cylinder=cylinder,
        std=std,
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


def _whitened(
    cylinder: Cylinder,
    readings: Readings,
    crossings: EndCrossings,
    camera: PinholeCamera,
) -> tuple[Float[Array, " n"], Float[Array, " m"]]:
    in_camera = _in_camera(cylinder, camera)
    return depth_residual(readings, in_camera), end_residual(crossings, in_camera)


def _minimize(
    chart: Chart, readings: Readings, crossings: EndCrossings, camera: PinholeCamera
) -> tuple[Float[Array, " n"], Bool[Array, ""], Bool[Array, ""], Int[Array, ""]]:
    """Levenberg-Marquardt in the chart's coordinates, from its reference."""

    def robust(vector: Float[Array, " n"], _: Any):
        rows = _whitened(chart.cylinder(vector), readings, crossings, camera)
        rows = jax.tree.map(lambda r: pseudo_huber_residual(r, ROBUST_WIDTH), rows)
        # A prior ten thousand deviations wide: the normal equations stay regular where
        # the image leaves a coordinate free.
        return *rows, 1e-2 * vector

    # A coordinate is ten deviations: steps below a hundredth of one end the search.
    solver = optx.LevenbergMarquardt(
        rtol=1e-5,
        atol=1e-3,
        norm=optx.rms_norm,
        linear_solver=lx.Normal(lx.Cholesky()),
    )
    # On a GPU the default precision of a product is that of 10-bit mantissas.
    with jax.default_matmul_precision("highest"):
        solution = optx.least_squares(
            robust,
            solver,
            jnp.zeros(chart.size, chart.unit.dtype),
            max_steps=MAX_STEPS,
            throw=False,
        )
    finite = jnp.all(jnp.isfinite(solution.value))
    converged = solution.result == optx.RESULTS.successful
    return solution.value, converged, finite, solution.stats["num_steps"]


def _signed(cylinder: Cylinder) -> Cylinder:
    """Turn the axis so that its largest component is positive."""
    axis = cylinder.axis
    largest = axis[jnp.argmax(jnp.abs(axis))]
    return eqx.tree_at(lambda c: c.axis, cylinder, jnp.where(largest < 0, -axis, axis))


def _seen_extent(
    cylinder: Cylinder,
    in_camera: Cylinder,
    readings: Readings,
    crossings: EndCrossings,
    inlier: Bool[Array, " n"],
) -> tuple[Cylinder, Bool[Array, "2"]]:
    """Tell which ends are seen, and draw an unseen one in to the last inlier.

    An end is seen through readings well inside its cap's disc, or where the wall gives
    way to background.
    """
    seen = surface_seen(readings.ray, in_camera)
    d = readings.ray.direction
    axis = in_camera.axis
    # The cap that is entered faces the camera: its outward normal opposes the ray. Seen
    # from inside, it is the other way round.
    faces = jnp.sign(d.x * axis[0] + d.y * axis[1] + d.z * axis[2])
    inside = in_camera.implicit(jax.tree.map(jnp.zeros_like, _origin(readings.ray))) < 0
    cap_end = jnp.where(inside, faces, -faces)
    on_cap = inlier & seen.on_cap & (seen.cap_distance < 0.9 * cylinder.radius)
    at_crossing = jnp.abs(end_residual(crossings, in_camera)) < 6
    at_crossing &= crossings.weight > 0
    ends_seen = jnp.stack(
        [
            jnp.sum(on_cap & (cap_end == end))
            + jnp.sum(at_crossing & (crossings.end == end))
            >= MIN_END_ROWS
            for end in (-1, 1)
        ]
    )
    on_wall = inlier & ~seen.on_cap
    half = cylinder.height / 2
    some = jnp.any(on_wall)
    first = jnp.min(jnp.where(on_wall, seen.along, jnp.inf))
    last = jnp.max(jnp.where(on_wall, seen.along, -jnp.inf))
    low = jnp.where(ends_seen[0] | ~some, -half, first)
    high = jnp.where(ends_seen[1] | ~some, half, last)
    whole = ~(high > low)
    low, high = jnp.where(whole, -half, low), jnp.where(whole, half, high)
    center = cylinder.center + cylinder.axis * ((low + high) / 2)
    extent = eqx.tree_at(lambda c: (c.center, c.height), cylinder, (center, high - low))
    return extent, ends_seen


def _origin(ray: Ray):
    return jax.tree.map(lambda field: field[0], ray.origin)


def _uncertainty(
    chart: Chart,
    readings: Readings,
    crossings: EndCrossings,
    camera: PinholeCamera,
    inlier: Bool[Array, " n"],
    ends_seen: Bool[Array, "2"],
) -> Deviations:
    def rows(vector: Float[Array, " n"]) -> Float[Array, " rows"]:
        depth_rows, end_rows = _whitened(
            chart.cylinder(vector), readings, crossings, camera
        )
        near = jnp.abs(jax.lax.stop_gradient(end_rows)) < 6
        return jnp.concatenate(
            [jnp.where(inlier, depth_rows, 0), jnp.where(near, end_rows, 0)]
        )

    zero = jnp.zeros(chart.size, chart.unit.dtype)
    squares = jnp.sum(rows(zero) ** 2)
    count = jnp.maximum(jnp.sum(inlier) - chart.size, 1)
    widening = jnp.sqrt(jnp.maximum(squares / count, 1))
    return deviations(chart, jax.jacfwd(rows)(zero), ends_seen, widening)


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
