"""Covariance of the fitted coordinates, from the Jacobian of the residuals."""

__all__ = ["coordinate_covariance", "deviations"]

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from impostor_jax.fit.parameterization import Chart
from impostor_jax.fit.result import Deviations
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.numerics import eps


def coordinate_covariance(
    jacobian: Float[Array, "rows n"], linear: Float[Array, "7 n"]
) -> Float[Array, "7 7"]:
    """Covariance of the seven natural coordinates at a solution.

    Args:
        jacobian: Of the whitened residuals in the free scaled coordinates. A column of
            zeros is a coordinate that no residual depends on; it is left out.
        linear: Natural coordinates (axis, across, log radius, lower, upper) in terms of
            the scaled ones.
    """
    information = jnp.matmul(jacobian.T, jacobian, precision="highest")
    diagonal = jnp.diagonal(information)
    size = diagonal.shape[0]
    depends = diagonal > 0
    scale = jnp.where(depends, jax.lax.rsqrt(jnp.where(depends, diagonal, 1)), 0)
    correlation = information * scale[:, None] * scale[None, :]
    correlation += jnp.diag(jnp.where(depends, 0, 1))
    values, vectors = jnp.linalg.eigh(correlation)
    # An eigenvalue within rounding of 0 is a direction that the image leaves free; at
    # this floor its deviation comes out a thousand times that of the others.
    inverse = 1 / jnp.maximum(values, eps(values.dtype, 4 * size))
    spread = (linear * scale[None, :]) @ (vectors * jnp.sqrt(inverse)[None, :])
    return jnp.matmul(spread, spread.T, precision="highest")


def deviations(
    chart: Chart,
    jacobian: Float[Array, "rows n"],
    ends_seen: Bool[Array, "2"],
    widening: Float[Array, ""],
) -> Deviations:
    """Standard deviations of a cylinder's parameters at the chart's reference.

    Args:
        chart: Centered on the solution.
        jacobian: Of the whitened residuals in the chart's scaled coordinates.
        ends_seen: Whether the lower and the upper end are determined.
        widening: Factor on all deviations, for residuals larger than their sigma.
    """
    zero = jnp.zeros(chart.size, jacobian.dtype)

    def natural(vector: Float[Array, " n"]) -> Float[Array, "7"]:
        c = chart.coordinates(vector)
        rest = jnp.stack([c.log_radius, c.lower, c.upper])
        return jnp.concatenate([c.axis, c.across, rest])

    covariance = coordinate_covariance(jacobian, jax.jacfwd(natural)(zero))
    covariance = covariance * widening**2
    axis, reference = chart.reference.axis, chart.reference
    to_center = jnp.zeros((3, 7), jacobian.dtype)
    to_center = to_center.at[:, 2:4].set(tangent_basis(axis).T)
    to_center = to_center.at[:, 5:7].set(axis[:, None] / 2)
    to_height = jnp.array([0, 0, 0, 0, 0, -1, 1], jacobian.dtype)
    variance = jnp.diagonal(covariance)
    center = jnp.einsum("ij,jk,ik->i", to_center, covariance, to_center)
    height = to_height @ covariance @ to_height
    center_held, height_held = "center" in chart.fixed, "height" in chart.fixed
    # With the height held, one end tells the place of both.
    slides = ~(ends_seen.any() if height_held else ends_seen.all())
    if not center_held:
        moves = jnp.abs(axis) > eps(axis.dtype, 4)
        center = jnp.where(slides & moves, jnp.inf, center)
    if not height_held:
        # With the center held, one end tells the height.
        free = ~(ends_seen.any() if center_held else ends_seen.all())
        height = jnp.where(free, jnp.inf, height)
    return Deviations(
        center=jnp.sqrt(center),
        across_axis=jnp.sqrt(variance[2:4]),
        axis=jnp.sqrt(variance[:2]),
        radius=jnp.sqrt(variance[4]) * reference.radius,
        height=jnp.sqrt(height),
    )
