"""Standard deviations of a fit, from the Jacobian of its residuals."""

__all__ = ["coordinate_covariance", "deviations"]

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from impostor_jax.fit.parameterization import Chart
from impostor_jax.fit.result import Deviations
from impostor_jax.numerics import eps


def coordinate_covariance(
    chart: Chart, jacobian: Float[Array, "rows n"]
) -> Float[Array, "7 7"]:
    """Covariance of the seven natural coordinates at the chart's reference.

    Args:
        chart: Centered on the solution.
        jacobian: Of the whitened residuals in the chart's free coordinates. A column of
            zeros is a coordinate that no residual depends on; it is left out.
    """
    information = jnp.matmul(jacobian.T, jacobian, precision="highest")
    diagonal = jnp.diagonal(information)
    depends = diagonal > 0
    size = jnp.where(depends, jax.lax.rsqrt(jnp.where(depends, diagonal, 1)), 0)
    correlation = information * size[:, None] * size[None, :]
    correlation += jnp.diag(jnp.where(depends, 0, 1).astype(size.dtype))
    values, vectors = jnp.linalg.eigh(correlation)
    # An eigenvalue within rounding of 0 is a direction that the image leaves free; at
    # this floor its deviation comes out a thousand times that of the others.
    values = jnp.maximum(values, eps(values.dtype, 4 * chart.size))
    root = jnp.matmul(
        chart.scale * size[None, :],
        vectors * jax.lax.rsqrt(values)[None, :],
        precision="highest",
    )
    return jnp.matmul(root, root.T, precision="highest")


def deviations(
    chart: Chart,
    jacobian: Float[Array, "rows n"],
    fixed: tuple[str, ...],
    ends_seen: Bool[Array, "2"],
    widening: Float[Array, ""],
) -> Deviations:
    """Standard deviations of a cylinder's parameters at the chart's reference.

    Args:
        chart: Centered on the solution.
        jacobian: Of the whitened residuals in the chart's free coordinates.
        fixed: Names of the parameters that are held.
        ends_seen: Whether the lower and the upper end are determined.
        widening: Factor on all deviations, for residuals larger than their sigma.
    """
    covariance = coordinate_covariance(chart, jacobian)
    motion, reference = chart.motion, chart.reference
    # A coordinate that no residual depends on has no variance above; it is unknown.
    without_effect = jnp.all(jacobian == 0, axis=0).astype(jacobian.dtype)
    unknown = jnp.matmul(jnp.abs(chart.scale), without_effect) > 0
    # Of center, axis and the logarithms of radius and height.
    variance = jnp.sum(
        jnp.matmul(motion, covariance, precision="highest") * motion, axis=1
    )
    own = jnp.sqrt(jnp.diagonal(covariance)) * widening
    own = jnp.where(unknown, jnp.inf, own)
    changed = jnp.sqrt(jnp.maximum(variance, 0)) * widening
    center, height = changed[:3], changed[7] * reference.height
    # One end is enough where the height or the center is held.
    held = "center" in fixed or "height" in fixed
    free_end = ~(jnp.any(ends_seen) if held else jnp.all(ends_seen))
    if "center" not in fixed:
        slides = jnp.abs(reference.axis) > eps(center.dtype, 4)
        center = jnp.where(free_end & slides, jnp.inf, center)
    if "height" not in fixed:
        height = jnp.where(free_end, jnp.inf, height)
    return Deviations(
        center=center,
        across_axis=own[2:4],
        axis=own[:2],
        radius=own[4] * reference.radius,
        height=height,
    )
