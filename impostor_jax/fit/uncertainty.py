"""Standard deviations of a fit, from the Jacobian of its residuals."""

__all__ = ["deviations", "free_covariance"]

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from impostor_jax.fit.parameterization import Chart
from impostor_jax.fit.result import Deviations
from impostor_jax.numerics import eps


def free_covariance(jacobian: Float[Array, "rows n"]) -> Float[Array, "n n"]:
    """Covariance of coordinates from the Jacobian of whitened residuals.

    A coordinate that no residual depends on gets no variance here.
    """
    information = jnp.matmul(jacobian.T, jacobian, precision="highest")
    diagonal = jnp.diagonal(information)
    depends = diagonal > 0
    size = jnp.where(depends, jax.lax.rsqrt(jnp.where(depends, diagonal, 1)), 0)
    correlation = information * size[:, None] * size[None, :]
    values, vectors = jnp.linalg.eigh(correlation)
    # An eigenvalue within rounding of 0 is a direction that the image leaves free; at
    # this floor its deviation comes out a thousand times that of the others.
    values = jnp.maximum(values, eps(values.dtype, 4 * values.shape[0]))
    root = size[:, None] * vectors * jax.lax.rsqrt(values)[None, :]
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
    # Center, axis, radius and height, then the tangent coordinates of axis and center.
    change = jnp.concatenate([chart.tangent(), chart.scale[:4]])
    covariance = free_covariance(jacobian)
    variance = jnp.sum(
        jnp.matmul(change, covariance, precision="highest") * change, axis=1
    )
    # A coordinate that no residual depends on has no variance above; it is unknown.
    without_effect = jnp.all(jacobian == 0, axis=0)
    unknown = jnp.any((change != 0) & without_effect[None, :], axis=1)
    # One end is enough where the height or the center is held.
    held = "center" in fixed or "height" in fixed
    free_end = ~(jnp.any(ends_seen) if held else jnp.all(ends_seen))
    slides = jnp.abs(change[:, -1]) > eps(change.dtype, 4) * chart.scale[-1, -1]
    # The last coordinate, which moves an end, is the one that a free end leaves open.
    unknown |= free_end & slides
    spread = jnp.where(unknown, jnp.inf, jnp.sqrt(variance) * widening)
    return Deviations(
        center=spread[:3],
        across_axis=spread[10:12],
        axis=spread[8:10],
        radius=spread[6],
        height=spread[7],
    )
