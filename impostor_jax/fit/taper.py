"""Whether the readings of a cylinder need a frustum: the likelihood ratio.

The frustum is fitted; what the image says is evaluated at that fit and held; and both
shapes are fitted to it. A cylinder is the frustum without taper, so twice the logarithm
of the ratio of their likelihoods, the difference of their losses, is chi-squared with
one degree of freedom where there is none (Wilks).
"""

__all__ = ["test_taper"]

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.arguments import working_precision
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.compiling import quickly_compiled
from impostor_jax.fit.evidence import gather_edge, gather_pixels
from impostor_jax.fit.minimize import lowest_loss
from impostor_jax.fit.options import Options
from impostor_jax.fit.parameterization import Chart
from impostor_jax.fit.prior import Prior
from impostor_jax.fit.request import (
    Request,
    checked_depth,
    checked_noise,
    checked_prior,
    checked_request,
)
from impostor_jax.fit.result import Fit, TaperTest
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


def test_taper(fit: Fit) -> TaperTest:
    """Fit a frustum where a cylinder was fitted, and compare the two.

        fit = ij.fit_cylinder(depth, camera)
        if ij.test_taper(fit).is_needed(): ...

    Args:
        fit: As `fit_cylinder` returned it.

    Raises:
        ValueError: It is of another shape, or of a traced call, or it was stacked or
            made anew since; or its radius was fixed or expected.
    """
    if not isinstance(fit.shape, Cylinder):
        found = type(fit.shape).__name__.lower()
        raise ValueError(
            f"fit must be of a cylinder to test its taper, got a {found}'s"
        )
    held = fit.asked.arguments
    if held is None:
        raise ValueError(
            "fit must be as fit_cylinder returned it to test its taper: one that was "
            "traced or stacked does not hold its image, nor one of too few readings"
        )
    options: Options = held["options"]
    if "radius" in {*options.fixed, *(options.prior or {})}:
        raise ValueError(
            "fit must leave the radius open to test its taper, got one in which it is "
            "fixed or expected: a frustum has two"
        )
    begin = fit.cylinder if fit.success else held["initial"]
    initial = None
    if begin is not None:
        half = unit(begin.axis) * (begin.height / 2)
        ends = begin.center - half, begin.center + half
        initial = Frustum(*ends, begin.radius, begin.radius)
    asked: dict[str, Any] = held | {"initial": initial}
    frustum = fit_shape(FRUSTUM, **asked)
    depth, camera, region, sigma = (
        asked[name] for name in ("depth", "camera", "mask", "sigma")
    )
    effort = options.effort
    request = checked_request(Frustum, FRUSTUM.parameters, options, initial, sigma)
    given = (depth, camera, region, sigma, options)
    with working_precision(effort.precision, given) as converted:
        noise, camera = converted((checked_noise(sigma), camera))
        image = np.asarray(checked_depth(depth, camera))
        # What of a mask the fit has taken; an outline is all of it.
        if options.mask_meaning == "region" and effort.stride == 1:
            region = np.asarray(frustum.region)
        shown = pixels_shown(image, region, camera, noise, effort.stride)
        prior = checked_prior(options.prior, FRUSTUM.parameters, initial)
        compared = quickly_compiled(_statistic, static_argnames="request")
        statistic = compared(*shown, frustum.frustum, converted(prior), request)
    if options.errors == "correlated":
        # As much larger as the radii's difference varies: the ratio is Wald's square.
        plain = dataclasses.replace(options, errors="independent")
        anew: dict[str, Any] = {
            "mask": region,
            "initial": frustum.frustum,
            "options": plain,
        }
        other = fit_shape(FRUSTUM, **asked | anew, is_whole=True)
        statistic = statistic * _of_difference(other) / _of_difference(frustum)
    p_value = jax.scipy.special.erfc(jnp.sqrt(statistic / 2))
    return TaperTest(
        frustum=frustum,
        statistic=jnp.where(frustum.success, statistic, jnp.nan),
        p_value=jnp.where(frustum.success, p_value, jnp.nan),
    )


def _of_difference(fit: Fit) -> Float[Array, ""]:
    """Variance of the difference of a frustum's radii."""
    first = fit.coordinates.index("radius1")
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
