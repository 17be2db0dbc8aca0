"""What a solution shows: its ends, its deviations, and whether it can be believed."""

__all__ = [
    "Solution",
    "Start",
    "assess",
    "deviations_of",
    "result_of",
]

from functools import partial
from typing import Any

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
from impostor_jax.fit.ball import Ball
from impostor_jax.fit.body import AbstractBody, SurfaceSeen
from impostor_jax.fit.evidence import Pixels
from impostor_jax.fit.parameterization import Chart
from impostor_jax.fit.prior import Prior, prior_residuals
from impostor_jax.fit.request import Request
from impostor_jax.fit.residuals import is_missed, residuals
from impostor_jax.fit.result import (
    DISAGREEING,
    STATUSES,
    AbstractFit,
    Deviations,
    Directions,
    FitResult,
    FitStatus,
    FrustumDeviations,
    FrustumFit,
    SphereDeviations,
    SphereFit,
)
from impostor_jax.fit.round_body import CylinderBody, FrustumBody, RoundBody
from impostor_jax.fit.rows import Rows
from impostor_jax.fit.uncertainty import free_covariance, score_covariance, spread
from impostor_jax.geometry.so3 import tangent_basis
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
) -> AbstractFit:
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
    ends_seen = jnp.ones(2, bool)
    if isinstance(body, RoundBody):
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
    if isinstance(body, RoundBody):
        # An end that is not seen is free, though some readings beyond it may lean on
        # it. The ends are the last coordinates.
        leans = jnp.concatenate([jnp.ones(natural.shape[0] - 2, bool), ends_seen])
        natural = jnp.where(leans[:, None], natural, 0)
    jacobian = jnp.matmul(chart.scale.T, natural, precision="highest")
    known = jax.jacfwd(lambda v: prior_residuals(prior, chart.body(v)))(
        jnp.zeros(chart.size, unit.dtype)
    )
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
    world = in_world_frame(body, camera)
    change = _changes(body, camera, chart, ends_seen)
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

    return result_of(
        world,
        std=jax.tree.map(lambda value: jnp.where(success, value, jnp.inf), std),
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


def result_of(
    body: AbstractBody, ends_seen: Bool[Array, "2"], **fields: Any
) -> AbstractFit:
    """Result of the kind that belongs to a body of the world."""
    if isinstance(body, CylinderBody):
        return FitResult(cylinder=body.shape, ends_seen=ends_seen, **fields)
    if isinstance(body, FrustumBody):
        return FrustumFit(frustum=body.shape, ends_seen=ends_seen, **fields)
    assert isinstance(body, Ball)
    return SphereFit(sphere=body.shape, **fields)


def _signed(solution: Solution, camera: PinholeCamera) -> Solution:
    """Turn the axis so that its largest component in the world is positive."""
    body = solution.body
    if not isinstance(body, RoundBody):
        return solution
    axis = body.axis
    if camera.camera_from_world is not None:
        axis = camera.camera_from_world.inverse().rotate(axis)
    sign = jnp.where(axis[jnp.argmax(jnp.abs(axis))] < 0, -1, 1).astype(axis.dtype)
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
    body: RoundBody,
    rows: Rows,
    seen: SurfaceSeen,
    believed: Bool[Array, " n"],
    depth: Float[Array, " m"],
    wide: Float[Array, ""],
) -> tuple[Bool[Array, "2"], RoundBody]:
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
    ends = jnp.array([-1, 1], shown.dtype)[:, None]
    counts = jnp.sum(believed[None] & (shown[None] == ends), axis=1)
    ends_seen = counts >= MIN_END_ROWS
    on_wall = believed[:num] & ~seen.on_cap
    outward = jnp.where(on_wall[None], seen.along[None] * ends, -jnp.inf)
    half = body.height / 2
    # How far the lower and the upper end lie from the center, each on its own side.
    reach = jnp.where(ends_seen, half, jnp.max(outward, axis=1))
    # Without a wall there is no extent to draw in to.
    height = jnp.sum(reach)
    reach = jnp.where(jnp.isfinite(height) & (height > 0), reach, half)
    return ends_seen, body.between(-reach[0], reach[1])


def _changes(
    body: AbstractBody,
    camera: PinholeCamera,
    chart: Chart,
    ends_seen: Bool[Array, "2"],
) -> Float[Array, "m n"]:
    """Derivative of the world's coordinates in free coordinates of the camera frame."""
    if not isinstance(body, RoundBody):
        moved = chart.scale[:3]
        if camera.camera_from_world is not None:
            moved = camera.camera_from_world.inverse().rotate(moved.T).T
        return jnp.concatenate([moved, body.radius * chart.scale[3:]])
    change = body.changes(chart.scale, chart.fixed, ends_seen)
    if camera.camera_from_world is None:
        return change
    # Each frame has tangent vectors of its own.
    back = camera.camera_from_world.inverse()
    turned = back.rotate(tangent_basis(body.axis))
    own = tangent_basis(back.rotate(body.axis))
    turn = jnp.matmul(own, turned.T, precision="highest")
    return jnp.concatenate([turn @ change[:2], turn @ change[2:4], change[4:]])


def deviations_of(
    body: AbstractBody,
    change: Float[Array, "m n"],
    covariance: Float[Array, "n n"],
    directions: Float[Array, "n n"],
    free: Bool[Array, " n"],
) -> tuple[eqx.Module, Float[Array, "m m"], Directions, Bool[Array, ""]]:
    """Deviations of a body of the world; and whether they leave its place known."""
    num = change.shape[0]
    quantities = change
    if isinstance(body, RoundBody):
        basis = tangent_basis(body.axis)
        frame = jnp.concatenate([basis.T, body.axis[:, None]], axis=1)
        points = jnp.matmul(frame, change[2:5], precision="highest")
        if isinstance(body, FrustumBody):
            way = jnp.matmul(basis.T, change[:2], precision="highest") * body.height
            way = (way + body.axis[:, None] * change[-1][None]) / 2
            points = jnp.concatenate([points - way, points + way])
        quantities = jnp.concatenate([change, points])
    full, is_observed = spread(quantities, covariance, directions, free)
    variance = jnp.where(is_observed, jnp.diagonal(full), jnp.inf)
    std = jnp.sqrt(variance)
    # Motions of the surface: an angle moves the ends by half the size.
    lengths = jnp.ones(num, full.dtype)
    if isinstance(body, RoundBody):
        lengths = lengths.at[:2].set(body.size)
        is_known = jnp.all(std[5 : num - 1] < body.radius / 2)
        is_known &= jnp.all(std[2:4] < body.radius / 2) & jnp.all(std[:2] < 0.5)
    else:
        is_known = jnp.all(std < body.radius / 2)
    if isinstance(body, CylinderBody):
        deviations = Deviations(
            center=std[7:],
            across_axis=std[2:4],
            axis=std[:2],
            radius=std[5],
            height=std[6],
        )
    elif isinstance(body, FrustumBody):
        deviations = FrustumDeviations(
            p1=std[8:11],
            p2=std[11:],
            across_axis=std[2:4],
            axis=std[:2],
            radius1=std[5],
            radius2=std[6],
            height=std[7],
        )
    else:
        deviations = SphereDeviations(center=std[:3], radius=std[3])
    size = body.size
    surface = full[:num, :num] * (lengths[:, None] * lengths[None])
    values, vectors = jnp.linalg.eigh(
        surface + jnp.diag(jnp.where(is_observed[:num], 0, 1e6 * size**2))
    )
    deviation = jnp.sqrt(jnp.maximum(values[::-1], 0))
    public = jnp.where(
        jnp.eye(num, dtype=bool), variance[:num][:, None], full[:num, :num]
    )
    observed = Directions(
        coordinates=is_observed[:num],
        vector=vectors.T[::-1],
        deviation=jnp.where(deviation > 500 * size, jnp.inf, deviation),
    )
    return deviations, public, observed, is_known


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
