"""What a solution shows: its ends, its deviations, and whether it can be believed."""

__all__ = ["Solution", "Start", "assess"]

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.evidence import Pixels
from impostor_jax.fit.parameterization import Chart
from impostor_jax.fit.prior import Prior, prior_residuals
from impostor_jax.fit.request import Request
from impostor_jax.fit.residuals import (
    Rows,
    SurfaceSeen,
    residuals,
)
from impostor_jax.fit.result import (
    STATUSES,
    Deviations,
    Directions,
    FitResult,
    FitStatus,
)
from impostor_jax.fit.uncertainty import free_covariance, score_covariance, spread
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.numerics import safe_divide, safe_sqrt
from impostor_jax.primitives.cylinder import Cylinder

MIN_END_ROWS = 5
"""Fewest inlying readings of a cap, or crossings, that show an end."""


class Start(eqx.Module):
    """Where the last part of a fit begins; several, (k,), the likeliest first.

    Attributes:
        cylinder: In the world frame.
        is_worth: Whether to begin here at all.
        num_steps: Steps of the solver so far.
        num_tried: Guesses that were tried.
        num_agreeing: Those that led here.
    """

    cylinder: Cylinder
    is_worth: Bool[Array, "*k"]
    num_steps: Int[Array, "*k"]
    num_tried: Int[Array, "*k"]
    num_agreeing: Int[Array, "*k"]

    @staticmethod
    def at(cylinder: Cylinder, count: int = 1) -> "Start":
        """The only guess, repeated where as many are expected."""
        # Typed as what `best_start` returns, so that the fit is compiled once for both.
        zero, one = jnp.zeros(count, int), jnp.ones(count, int)
        repeated = jax.tree.map(lambda a: jnp.repeat(a[None], count, axis=0), cylinder)
        return Start(repeated, jnp.arange(count) == 0, zero, one, one)


class Solution(eqx.Module):
    """An estimate in the camera frame, and the image evaluated at it.

    Attributes:
        cylinder: The estimate.
        rows: Readings first, then crossings.
        seen: What the readings' rays see.
        scale: Robust standard deviation of the whitened residuals, at least 1.
        converged: Whether the solver did.
        num_steps: Steps that it took.
        moved: Root mean square of the coordinates by which the last stage moved it.
    """

    cylinder: Cylinder
    rows: Rows
    seen: SurfaceSeen
    scale: Float[Array, ""]
    converged: Bool[Array, ""]
    num_steps: Int[Array, ""]
    moved: Float[Array, ""]


def assess(
    start: Start,
    solution: Solution,
    pixels: Pixels,
    row: Int[Array, " n"],
    col: Int[Array, " n"],
    camera: PinholeCamera,
    unit: Float[Array, ""],
    prior: Prior,
    request: Request,
    always: Bool[Array, ""],
) -> FitResult:
    """Result of a fit in the world frame.

    Args:
        start: Where the solution began.
        solution: The estimate.
        pixels: Pixels of the object.
        row: Their rows.
        col: Their columns.
        camera: The camera.
        unit: Size of a step, in meters.
        prior: In the camera frame.
        request: What was asked for.
        always: As in `residuals`.
    """
    solution = _signed(solution, camera)
    rows, seen, cylinder = solution.rows, solution.seen, solution.cylinder
    num = pixels.depth.shape[0]
    used = pixels.depth > 0
    count = jnp.sum(used)
    meters = jnp.where(used, pixels.depth - seen.depth, 0)
    whitened, gradient = residuals(rows, cylinder, always)
    wide = solution.scale
    inlier = used & (jnp.abs(whitened[:num]) <= 3 * wide)
    # The residuals take a cap for a whole plane; readings beyond its rim are not on it.
    inlier &= ~(seen.on_cap & (seen.cap_distance > 1.05))
    crossing = (rows.weight[num:] > 0) & (jnp.abs(whitened[num:]) < 6)
    believed = jnp.concatenate([inlier, crossing])
    extent, ends_seen = _seen_extent(cylinder, rows, seen, believed, pixels.depth, wide)
    held = {*request.fixed, *(n for n in ("center", "height") if getattr(prior, n))}
    if not {"center", "height"} & held:
        cylinder = extent
    num_inliers = jnp.maximum(jnp.sum(inlier), 1).astype(meters.dtype)
    rms = jnp.sqrt(jnp.sum(jnp.where(inlier, meters, 0) ** 2) / num_inliers)
    squares = jnp.sum(jnp.where(inlier, whitened[:num], 0) ** 2)

    chart = Chart.around(cylinder, unit, unit, request.fixed)
    # An end that is not seen is free, though some readings beyond it may lean on it.
    leans = jnp.concatenate([jnp.ones(5, bool), ends_seen])
    natural = jnp.matmul(gradient.T, chart.natural(), precision="highest")
    natural = jnp.where(believed[:, None] & leans[None], natural, 0)
    jacobian = jnp.matmul(natural, chart.scale, precision="highest")
    known = jax.jacfwd(lambda v: prior_residuals(prior, chart.cylinder(v)))(
        jnp.zeros(chart.size, unit.dtype)
    )
    widening = jnp.maximum(squares / num_inliers, 1)
    stacked = jnp.concatenate([jacobian * jax.lax.rsqrt(widening), known])
    covariance, directions, free = free_covariance(stacked)
    if request.correlated:
        meat = score_covariance(
            jacobian[:num],
            jnp.where(inlier, whitened[:num], 0),
            row,
            col,
            (camera.height, camera.width),
        )
        rest = jnp.concatenate([jacobian[num:], known])
        meat = meat / widening**2 + jnp.matmul(rest.T, rest, precision="highest")
        covariance = covariance @ meat @ covariance
    world, std, covariance, observed = _in_world(
        cylinder, camera, chart, covariance, directions, free
    )
    code = _status_code(
        converged=solution.converged,
        finite=jnp.isfinite(cylinder.radius) & jnp.all(jnp.isfinite(cylinder.center)),
        fits=(2 * num_inliers >= count.astype(meters.dtype))
        & ((wide < 5) | (wide < cylinder.radius * jnp.max(rows.weight[:num]) / 50)),
        determined=~_is_as_flat(pixels, rows.weight[:num], inlier, squares)
        & (std.radius < cylinder.radius / 2)
        & jnp.all(std.across_axis < cylinder.radius / 2)
        & jnp.all(std.axis < 0.5),
    )
    success = code == STATUSES.index(FitStatus.CONVERGED)

    def image_of(values: Array) -> Array:
        blank = jnp.zeros((camera.height, camera.width), values.dtype)
        return blank.at[row, col].set(values, mode="drop")

    return FitResult(
        cylinder=world,
        std=jax.tree.map(lambda value: jnp.where(success, value, jnp.inf), std),
        covariance=covariance,
        observed=observed,
        success=success,
        status_code=code,
        num_steps=start.num_steps + solution.num_steps,
        num_starts=start.num_tried,
        num_agreeing=start.num_agreeing,
        residual=image_of(meters),
        inliers=image_of(inlier),
        region=image_of(used),
        ends_seen=ends_seen,
        num_pixels=count,
        rms=rms,
    )


def _signed(solution: Solution, camera: PinholeCamera) -> Solution:
    """Turn the axis so that its largest component in the world is positive."""
    axis = solution.cylinder.axis
    if camera.camera_from_world is not None:
        axis = camera.camera_from_world.inverse().rotate(axis)
    sign = jnp.where(axis[jnp.argmax(jnp.abs(axis))] < 0, -1, 1).astype(axis.dtype)
    return eqx.tree_at(
        lambda s: (
            s.cylinder.axis,
            s.rows.end,
            s.seen.slope,
            s.seen.along,
        ),
        solution,
        (
            solution.cylinder.axis * sign,
            solution.rows.end * sign,
            solution.seen.slope * sign,
            solution.seen.along * sign,
        ),
    )


def _seen_extent(
    cylinder: Cylinder,
    rows: Rows,
    seen: SurfaceSeen,
    believed: Bool[Array, " n"],
    depth: Float[Array, " m"],
    wide: Float[Array, ""],
) -> tuple[Cylinder, Bool[Array, "2"]]:
    """Tell which ends are seen, and draw an unseen one in to the last inlier.

    An end is seen through readings of its cap, or where the wall gives way to
    background.

    Args:
        cylinder: The estimate.
        rows: Readings first, then crossings.
        seen: What the readings' rays see.
        believed: Rows that agree with the estimate.
        depth: The readings, in meters.
        wide: Robust deviation of whitened residuals.
    """
    num = seen.depth.shape[0]
    # A cap shows where its readings could not be the wall's, if that went on.
    sign = jnp.where(seen.outside, -1.0, 1.0)
    wall = seen.nearest + sign * safe_sqrt(seen.square)
    is_wall = jnp.abs(wall - depth) * rows.weight[:num] <= 3 * wide
    on_cap = seen.on_cap & (seen.cap_distance < 1) & ~is_wall
    facing = sign * jnp.sign(seen.slope)
    shown = jnp.concatenate([jnp.where(on_cap, facing, 0), rows.end[num:]])
    ends = jnp.array([-1, 1], shown.dtype)[:, None]
    counts = jnp.sum(believed[None] & (shown[None] == ends), axis=1)
    ends_seen = counts >= MIN_END_ROWS
    on_wall = believed[:num] & ~seen.on_cap
    outward = jnp.where(on_wall[None], seen.along[None] * ends, -jnp.inf)
    half = cylinder.height / 2
    # How far the lower and the upper end lie from the center, each on its own side.
    reach = jnp.where(ends_seen, half, jnp.max(outward, axis=1))
    # Without a wall there is no extent to draw in to.
    height = jnp.sum(reach)
    has_wall = jnp.isfinite(height) & (height > 0)
    shift = jnp.where(has_wall, reach[1] - reach[0], 0) / 2
    height = jnp.where(has_wall, height, cylinder.height)
    center = cylinder.center + cylinder.axis * shift
    return (
        eqx.tree_at(lambda c: (c.center, c.height), cylinder, (center, height)),
        ends_seen,
    )


def _in_world(
    cylinder: Cylinder,
    camera: PinholeCamera,
    chart: Chart,
    covariance: Float[Array, "n n"],
    directions: Float[Array, "n n"],
    free: Bool[Array, " n"],
) -> tuple[Cylinder, Deviations, Float[Array, "7 7"], Directions]:
    """Express a solution and its covariance in the world."""
    change = chart.quantities()
    basis = tangent_basis(cylinder.axis)
    if camera.camera_from_world is not None:
        back = camera.camera_from_world.inverse()
        cylinder = cylinder.transformed(back)
        turned = back.rotate(basis)
        # Each frame has tangent vectors of its own.
        basis = tangent_basis(cylinder.axis)
        turn = jnp.matmul(basis, turned.T, precision="highest")
        change = jnp.concatenate([turn @ change[:2], turn @ change[2:4], change[4:]])
    frame = jnp.concatenate([basis.T, cylinder.axis[:, None]], axis=1)
    center = jnp.matmul(frame, change[2:5], precision="highest")
    quantities = jnp.concatenate([change, center])
    full, observed = spread(quantities, covariance, directions, free)
    variance = jnp.where(observed, jnp.diagonal(full), jnp.inf)
    std = jnp.sqrt(variance)
    public = jnp.where(jnp.eye(7, dtype=bool), variance[:7][:, None], full[:7, :7])
    # Motions of the surface: an angle moves the ends by half the size.
    size = (cylinder.height + cylinder.radius) / 2
    lengths = jnp.concatenate([size[None], size[None], jnp.ones(5, size.dtype)])
    surface = full[:7, :7] * (lengths[:, None] * lengths[None])
    values, vectors = jnp.linalg.eigh(
        surface + jnp.diag(jnp.where(observed[:7], 0, 1e6 * size**2))
    )
    deviation = jnp.sqrt(jnp.maximum(values[::-1], 0))
    return (
        cylinder,
        Deviations(
            center=std[7:],
            across_axis=std[2:4],
            axis=std[:2],
            radius=std[5],
            height=std[6],
        ),
        public,
        Directions(
            coordinates=observed[:7],
            vector=vectors.T[::-1],
            deviation=jnp.where(deviation > 500 * size, jnp.inf, deviation),
        ),
    )


def _status_code(
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


def _is_as_flat(
    pixels: Pixels,
    weight: Float[Array, " n"],
    inlier: Bool[Array, " n"],
    squares: Float[Array, ""],
) -> Bool[Array, ""]:
    """Whether a plane explains the readings as well as the cylinder does.

    A plane is linear in inverse depth over the rays, so one linear solve finds it. A
    cylinder has to beat it by 25, in squared deviations.

    Args:
        pixels: The readings.
        weight: Inverse of their standard deviations.
        inlier: Readings that lie on the cylinder.
        squares: Sum of their squared residuals from it, in deviations.
    """
    d, depth = pixels.direction, pixels.depth
    inverse = jnp.where(inlier, 1 / jnp.where(inlier, depth, 1), 0)
    weight = jnp.where(inlier, weight * depth, 0)
    rays = jnp.stack([d.x, d.y, d.z]) * (weight * depth)[None]
    normal = jnp.matmul(rays, rays.T, precision="highest")
    right = jnp.matmul(rays, weight * depth * inverse, precision="highest")
    # Cramer's rule: the rows of the adjugate are cross products.
    adjugate = jnp.cross(jnp.roll(normal, -1, axis=0), jnp.roll(normal, -2, axis=0))
    determinant = jnp.sum(normal[0] * adjugate[0])
    inverse_determinant = safe_divide(jnp.ones_like(determinant), determinant)
    plane = jnp.sum(adjugate.T * right[None], axis=1) * inverse_determinant
    flat = jnp.matmul(plane, rays, precision="highest") - weight * depth * inverse
    scale = jnp.maximum(
        squares / jnp.maximum(jnp.sum(inlier), 1).astype(depth.dtype), 1
    )
    return jnp.sum(flat**2) < squares + 25 * scale
