"""What a solution shows: its ends, its deviations, and whether it can be believed."""

__all__ = ["Solution", "Start", "assess"]

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.agreement import (
    contradiction,
    on_border,
    reduced_chi2,
    strays,
    tail,
)
from impostor_jax.fit.body import (
    AbstractBody,
    Readout,
    SurfaceSeen,
    coordinates_of,
)
from impostor_jax.fit.deviations import deviations_of
from impostor_jax.fit.evidence import Pixels
from impostor_jax.fit.parameterization import Chart
from impostor_jax.fit.prior import Prior, prior_residuals
from impostor_jax.fit.request import Request
from impostor_jax.fit.residuals import is_missed, residuals
from impostor_jax.fit.result import DISAGREEING, STATUSES, Fit, FitStatus
from impostor_jax.fit.rows import Rows
from impostor_jax.fit.uncertainty import free_covariance, score_covariance
from impostor_jax.numerics import safe_divide, safe_sqrt
from impostor_jax.primitives.base import in_world_frame

MOST_CHI2 = 9.0
"""Reduced chi-squared up to which readings may be of the shape, where their noise is
known: residuals of three deviations. The bands of a structured-light sensor, 1.5 mm and
more where single readings scatter by one, stay below; a can of half the radius that is
held does not."""

MOST_UNMET = 0.02
"""Share of the inliers whose rays may miss the shape."""

MIN_END_ROWS = 5
"""Fewest inlying readings of a cap, or crossings, that show an end."""


class Start(eqx.Module):
    """Where the last part of a fit begins; several, (k,), the likeliest first.

    Attributes:
        body: In the world frame.
        is_worth: Whether to begin here at all.
        num_steps: Steps of the solver so far.
        num_tried: Guesses that were tried.
        num_agreeing: Those that led here.
    """

    body: AbstractBody
    is_worth: Bool[Array, "*k"]
    num_steps: Int[Array, "*k"]
    num_tried: Int[Array, "*k"]
    num_agreeing: Int[Array, "*k"]

    @staticmethod
    @partial(jax.jit, static_argnums=1)
    def at(body: AbstractBody, count: int = 1) -> "Start":
        """The only guess, repeated where as many are expected."""
        # Typed as what `best_start` returns, so that the fit is compiled once for both.
        zero, one = jnp.zeros(count, int), jnp.ones(count, int)
        repeated = jax.tree.map(lambda a: jnp.repeat(a[None], count, axis=0), body)
        return Start(repeated, jnp.arange(count) == 0, zero, one, one)


class Solution(eqx.Module):
    """An estimate in the camera frame, and the image evaluated at it.

    Attributes:
        body: The estimate.
        rows: Readings first, then crossings.
        seen: What the readings' rays see.
        scale: Robust standard deviation of the whitened residuals, at least 1.
        converged: Whether the solver did.
        num_steps: Steps that it took.
        moved: Coordinates by which the last stage moved it.
        left: Root mean square of those by which more stages like it still would.
    """

    body: AbstractBody
    rows: Rows
    seen: SurfaceSeen
    scale: Float[Array, ""]
    converged: Bool[Array, ""]
    num_steps: Int[Array, ""]
    moved: Float[Array, " n"]
    left: Float[Array, ""]


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
    mask: Bool[Array, "h w"],
) -> Fit:
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
        mask: Pixels of the object.
    """
    if not request.keep_ends:
        solution = _signed(solution, camera)
    rows, seen, body = solution.rows, solution.seen, solution.body
    num = pixels.depth.shape[0]
    used = pixels.depth > 0
    count = jnp.sum(used)
    meters = jnp.where(used, pixels.depth - seen.depth, 0)
    whitened, gradient = residuals(rows, body, always, request.fixed)
    wide = solution.scale
    inlier = used & (jnp.abs(whitened[:num]) <= 3 * wide)
    # The residuals take a cap for a whole plane; readings beyond its rim are not on it.
    inlier &= ~(seen.on_cap & (seen.cap_distance > 1.05))
    crossing = (rows.weight[num:] > 0) & (jnp.abs(whitened[num:]) < 6)
    believed = jnp.concatenate([inlier, crossing])
    ends_seen, extent = _seen_extent(body, rows, seen, believed, pixels.depth, wide)
    held = {*request.fixed, *(n for n in ("center", "height") if getattr(prior, n))}
    if not {"center", "height"} & held:
        body = extent
    num_inliers = jnp.maximum(jnp.sum(inlier), 1).astype(meters.dtype)
    rms = jnp.sqrt(jnp.sum(jnp.where(inlier, meters, 0) ** 2) / num_inliers)
    squares = jnp.sum(jnp.where(inlier, whitened[:num], 0) ** 2)

    chart = Chart.around(body, unit, unit, request.fixed)
    # Coordinates first: rows side by side are what vectors of a processor take.
    natural = jnp.matmul(chart.natural().T, gradient, precision="highest")
    natural = jnp.where(believed[None], natural, 0)
    # An end that is not seen is free, though some readings beyond it may lean on it.
    # The ends are the last coordinates.
    others = jnp.ones(natural.shape[0] - ends_seen.size, bool)
    leans = jnp.concatenate([others, ends_seen])
    natural = jnp.where(leans[:, None], natural, 0)
    jacobian = jnp.matmul(chart.scale.T, natural, precision="highest")
    world = in_world_frame(body, camera)

    def read(free: Float[Array, " c"]) -> tuple[Readout, Float[Array, " p"]]:
        moved = chart.body(free)
        told = in_world_frame(moved, camera).readout(world, ends_seen)
        return told, prior_residuals(prior, moved)

    change, known = jax.jacfwd(read)(jnp.zeros(chart.size, unit.dtype))
    # What is held stays, whatever moves the place at which it is read.
    for name in filter(change.__contains__, request.fixed):
        change[name] = jnp.zeros_like(change[name])
    widening = jnp.maximum(squares / num_inliers, 1)
    of_prior = jnp.matmul(known.T, known, precision="highest")
    information = jnp.matmul(jacobian, jacobian.T, precision="highest")
    covariance, directions, free = free_covariance(information / widening + of_prior)
    beside = on_border(mask, row, col)
    normal = jax.lax.rsqrt(widening)
    statistic = contradiction(
        jacobian * normal,
        jnp.where(believed, whitened, 0) * normal,
        believed & jnp.concatenate([beside, jnp.zeros_like(crossing)]),
        covariance,
        jnp.matmul(known.T, prior_residuals(prior, body), precision="highest"),
    )
    if request.correlated:
        meat = score_covariance(
            jacobian[:, :num].T,
            jnp.where(inlier, whitened[:num], 0),
            row,
            col,
            (camera.height, camera.width),
        )
        edges = jacobian[:, num:]
        of_edges = jnp.matmul(edges, edges.T, precision="highest")
        meat = meat / widening**2 + of_edges + of_prior
        independent = jnp.diagonal(covariance)
        covariance = covariance @ meat @ covariance
        # Errors that neighbors share let a part pull harder by as much as they widen
        # the deviations.
        wider = safe_divide(jnp.diagonal(covariance), independent)
        statistic = statistic / jnp.maximum(jnp.mean(wider), 1)
    std, covariance, observed, is_known = deviations_of(
        world, change, covariance, directions, free
    )
    statistic = jnp.where(strays(inlier, used, beside), jnp.inf, statistic)
    chi2 = reduced_chi2(squares, num_inliers)
    num_missed = jnp.sum(inlier & is_missed(seen), dtype=meters.dtype)
    # More readings than not, on a shape that their rays meet.
    agrees = [
        2 * num_inliers >= count.astype(meters.dtype),
        num_missed <= MOST_UNMET * num_inliers,
    ]
    if request.trusts_sigma:
        agrees.append(chi2 < MOST_CHI2)
    else:
        finest = jnp.max(rows.weight[:num])
        agrees.append((wide < 5) | (wide < body.radius * finest / 50))
    if request.is_traced:
        # A fit that is not traced goes on with what agrees, and takes errors that do
        # not for correlated.
        agrees.append(statistic < (DISAGREEING if request.correlated else np.inf))
    code = _status_code(
        converged=solution.converged,
        finite=jnp.isfinite(body.radius) & jnp.all(jnp.isfinite(body.center)),
        fits=jnp.stack(agrees).all(),
        determined=~_is_as_flat(pixels, rows.weight[:num], inlier, squares) & is_known,
    )
    success = code == STATUSES.index(FitStatus.CONVERGED)

    def image_of(values: Array) -> Array:
        blank = jnp.zeros((camera.height, camera.width), values.dtype)
        return blank.at[row, col].set(values, mode="drop")

    return Fit(
        shape=world.shape,
        std=jax.tree.map(lambda value: jnp.where(success, value, jnp.inf), std),
        coordinates=coordinates_of(world),
        ends_seen=ends_seen,
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
        num_pixels=count,
        rms=rms,
        chi2=chi2,
        p_value=tail(chi2, num_inliers - chart.size)
        if request.trusts_sigma
        else jnp.full_like(chi2, jnp.nan),
        border_chi2=statistic,
    )


def _signed(solution: Solution, camera: PinholeCamera) -> Solution:
    """Turn the axis so that its largest component in the world is positive."""
    body = solution.body
    sign = in_world_frame(body, camera).sign
    return eqx.tree_at(
        lambda s: (s.body, s.rows.end, s.seen.slope, s.seen.along),
        solution,
        (
            body.reversed(sign),
            solution.rows.end * sign,
            solution.seen.slope * sign,
            solution.seen.along * sign,
        ),
    )


def _seen_extent(
    body: AbstractBody,
    rows: Rows,
    seen: SurfaceSeen,
    believed: Bool[Array, " n"],
    depth: Float[Array, " m"],
    wide: Float[Array, ""],
) -> tuple[Bool[Array, " e"], AbstractBody]:
    """Tell which ends are seen, and draw an unseen one in to the last inlier.

    An end is seen through readings of its cap, or where the wall gives way to
    background.

    Args:
        body: The estimate.
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
    ends = jnp.array(body.ends, shown.dtype)[:, None]
    counts = jnp.sum(believed[None] & (shown[None] == ends), axis=1)
    ends_seen = counts >= MIN_END_ROWS
    on_wall = believed[:num] & ~seen.on_cap
    outward = jnp.where(on_wall[None], seen.along[None] * ends, -jnp.inf)
    return ends_seen, body.drawn_in(ends_seen, jnp.max(outward, axis=1))


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
    """Whether a plane explains the readings as well as the body does.

    A plane is linear in inverse depth over the rays, so one linear solve finds it. A
    body has to beat it by 25, in squared deviations.

    Args:
        pixels: The readings.
        weight: Inverse of their standard deviations.
        inlier: Readings that lie on the body.
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
