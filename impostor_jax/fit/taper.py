"""Whether the readings of a cylinder need a frustum: the likelihood ratio.

The frustum is fitted; what the image says is evaluated at that fit and held; and both
shapes are fitted to it. A cylinder is the frustum without taper, so twice the logarithm
of the ratio of their likelihoods, the difference of their losses, is chi-squared with
one degree of freedom where there is none (Wilks).
"""

__all__ = ["taper_test"]

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.arguments import working_precision
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.compiling import quickly_compiled
from impostor_jax.effort import effort_of
from impostor_jax.fit.evidence import gather_edge, gather_pixels
from impostor_jax.fit.parameterization import FRUSTUM_COORDINATES, Chart
from impostor_jax.fit.prior import Prior
from impostor_jax.fit.request import (
    Request,
    checked_depth,
    checked_mask,
    checked_noise,
    checked_prior,
    checked_request,
)
from impostor_jax.fit.result import AbstractFit, FrustumFit, TaperTest
from impostor_jax.fit.robust import KERNELS
from impostor_jax.fit.round_body import CylinderBody, FrustumBody
from impostor_jax.fit.shapes import FRUSTUM, fit_shape, pixels_shown
from impostor_jax.fit.solve import (
    LAST_STAGES,
    always_true,
    evaluate,
    step_units,
)
from impostor_jax.geometry.vec3 import unit
from impostor_jax.primitives.base import in_camera_frame
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.sensor.base import AbstractDepthNoise

INLYING = 3.0
"""Robust deviations within which a reading tells how readings scatter."""


def taper_test(
    depth: Any,
    camera: PinholeCamera,
    mask: Any,
    begin: Cylinder | None,
    asked: dict[str, Any],
) -> TaperTest:
    """Fit a frustum, and compare a cylinder with it.

    Args:
        depth: As in `fit_cylinder`.
        camera: As in `fit_cylinder`.
        mask: As in `fit_cylinder`.
        begin: Cylinder to begin with; None to begin with guesses.
        asked: The other arguments of `fit_cylinder`; none is a cylinder's alone.
    """
    initial = None
    if begin is not None:
        half = unit(begin.axis) * (begin.height / 2)
        ends = begin.center - half, begin.center + half
        initial = Frustum(*ends, begin.radius, begin.radius)
    frustum = fit_shape(FRUSTUM, depth, camera, mask, initial=initial, **asked)
    assert isinstance(frustum, FrustumFit)
    effort = effort_of(asked["effort"])
    request = checked_request(
        Frustum,
        FRUSTUM.parameters,
        asked["fixed"],
        initial,
        asked["mask_meaning"],
        asked["scale"],
        asked["errors"],
        effort,
        asked["sigma"],
    )
    with working_precision(effort.precision, (depth, camera, mask, asked)) as converted:
        noise, camera = converted((checked_noise(asked["sigma"]), camera))
        image = np.asarray(checked_depth(depth, camera))
        # What of a mask the fit has taken; an outline is all of it.
        is_part = asked["mask_meaning"] == "region" and effort.stride == 1
        region = frustum.region if is_part else checked_mask(mask, camera)
        region = np.asarray(region)
        shown = pixels_shown(image, region, camera, noise, effort.stride)
        prior = checked_prior(asked["prior"], FRUSTUM.parameters, initial)
        compared = quickly_compiled(_statistic, static_argnames="request")
        statistic = compared(*shown, frustum.frustum, converted(prior), request)
    if asked["errors"] == "correlated":
        # As much larger as the radii's difference varies: the ratio is Wald's square.
        plain: dict[str, Any] = asked | {"errors": "independent"}
        other = fit_shape(
            FRUSTUM,
            depth,
            camera,
            region,
            initial=frustum.frustum,
            is_whole=True,
            **plain,
        )
        statistic = statistic * _of_difference(other) / _of_difference(frustum)
    p_value = jax.scipy.special.erfc(jnp.sqrt(statistic / 2))
    return TaperTest(
        frustum=frustum,
        statistic=jnp.where(frustum.success, statistic, jnp.nan),
        p_value=jnp.where(frustum.success, p_value, jnp.nan),
    )


def _of_difference(fit: AbstractFit) -> Float[Array, ""]:
    """Variance of the difference of a frustum's radii."""
    first = FRUSTUM_COORDINATES.index("radius1")
    (one, both), (_, two) = fit.covariance[first : first + 2, first : first + 2]
    return one + two - 2 * both


def _statistic(
    depth: Float[Array, "h w"],
    mask: Bool[Array, "h w"],
    row: Int[Array, " n"],
    col: Int[Array, " n"],
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
    frustum: Frustum,
    prior: Prior,
    request: Request,
) -> Float[Array, ""]:
    """Twice the logarithm of the likelihood ratio, frustum against cylinder.

    It is in the scale of the frustum's residuals, where they exceed the sensor's.

    Args:
        depth: In meters; 0 where there is no reading.
        mask: Pixels of the object.
        row: Rows of the object's pixels; one beyond the image only fills up.
        col: Columns of the object's pixels.
        camera: The camera.
        noise: Of its readings.
        frustum: The fitted frustum, in the world frame.
        prior: Of the cylinder, in the world frame.
        request: What was asked of the fits.
    """
    # Here, as in `solve`: optimistix takes long to import.
    from impostor_jax.fit.minimize import lowest_loss

    depth = depth.astype(frustum.radius1.dtype)
    pixels = gather_pixels(depth, camera, row, col)
    edge = gather_edge(depth, mask, camera, row, col)
    _, units = step_units(pixels, noise, camera)
    prior = prior.in_camera_frame(camera)
    always = always_true(camera)
    tapered = FrustumBody.of(in_camera_frame(frustum, camera))
    straight = CylinderBody(
        center=tapered.center,
        axis=tapered.axis,
        radius=tapered.radius,
        height=tapered.height,
    )
    *_, place, _ = LAST_STAGES[-1]
    place = jnp.asarray(place, depth.dtype)
    rows, seen, scale = evaluate(
        pixels, edge, noise, request.is_outline, tapered, jnp.zeros_like(place), place
    )
    _, width = KERNELS[request.kernel]
    width = width * (scale if request.estimate_scale else jnp.ones_like(scale))

    def loss(body: CylinderBody | FrustumBody) -> Float[Array, ""]:
        chart = Chart.around(body, *units, request.fixed)
        return lowest_loss(chart, rows, prior, width, request, always)

    whitened = (seen.depth - pixels.depth) * rows.weight[: pixels.depth.shape[0]]
    inlying = (pixels.depth > 0) & (jnp.abs(whitened) < INLYING * scale)
    squares = jnp.sum(jnp.where(inlying, whitened**2, 0))
    scatter = squares / jnp.maximum(jnp.sum(inlying), 1).astype(squares.dtype)
    gain = loss(straight) - loss(tapered)
    return jnp.maximum(gain, 0) / jnp.maximum(scatter, 1)
