"""The Cramér-Rao bound of a fit to the depths of one image."""

__all__ = ["bound", "error", "least_deviation"]

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

import impostor_jax as ij
from impostor_jax.geometry.so3 import tangent_basis


def error(estimate: ij.Cylinder, truth: ij.Cylinder) -> Float[np.ndarray, "7"]:
    """Estimate less truth, in the coordinates of `Fit.covariance`."""
    a = np.asarray(truth.axis, float)
    basis = np.asarray(tangent_basis(truth.axis), float)
    axis = np.asarray(estimate.axis, float)
    axis = axis * np.sign(axis @ a)
    moved = np.asarray(estimate.center, float) - np.asarray(truth.center, float)
    return np.concatenate(
        [
            basis @ (axis - a),
            basis @ moved,
            [
                moved @ a,
                float(estimate.radius) - float(truth.radius),
                float(estimate.height) - float(truth.height),
            ],
        ]
    )


def bound(
    cylinder: ij.Cylinder,
    camera: ij.PinholeCamera,
    mask: Bool[np.ndarray, "h w"],
    sigma: float | Float[np.ndarray, "h w"],
    least_cosine: float = 0.0,
) -> Float[np.ndarray, "7"]:
    """Least standard deviation of any unbiased estimate from the mask's depths.

    From the exact derivatives of all depths, in double precision, with the mask given.
    `inf` for coordinates that the depths leave free.

    Args:
        cylinder: The truth, in the camera frame.
        camera: The camera.
        mask: Pixels whose depths are read.
        sigma: Standard deviation of a reading, in meters.
        least_cosine: Pixels seen at a smaller cosine of incidence are left out.
    """
    with jax.enable_x64(True):
        values = (cylinder.center, cylinder.axis, cylinder.radius, cylinder.height)
        exact = [np.asarray(value, np.float64) for value in values]
        columns, cosine = _derivatives(*exact, camera)
    used = mask & (np.asarray(cosine) >= least_cosine)
    spread = np.broadcast_to(np.asarray(sigma, float), mask.shape)[used]
    return least_deviation(np.asarray(columns)[used] / spread[:, None])


def least_deviation(jacobian: Float[np.ndarray, "n k"]) -> Float[np.ndarray, " k"]:
    """The bound from the derivatives of all readings, in their deviations."""
    lengths = np.linalg.norm(jacobian, axis=0)
    # What rounding leaves of a coordinate without effect is none.
    free = lengths <= 1e-12 * lengths.max()
    size = np.where(free, 1, lengths)
    jacobian = np.where(free, 0, jacobian)
    information = (jacobian / size).T @ (jacobian / size)
    values, vectors = np.linalg.eigh(information)
    null = values < 1e-12
    variance = np.sum(vectors[:, ~null] ** 2 / values[~null], axis=1) / size**2
    opened = free | (np.max(np.abs(vectors[:, null]), axis=1, initial=0) > 1e-3)
    return np.where(opened, np.inf, np.sqrt(variance))


@jax.jit
def _derivatives(center, axis, radius, height, camera):
    basis = tangent_basis(axis)

    def depth(move):
        moved = ij.Cylinder(
            center + basis.T @ move[2:4] + axis * move[4],
            axis + basis.T @ move[:2],
            radius + move[5],
            height + move[6],
        )
        maps = ij.render(moved, camera, outputs=("depth",))
        assert maps.depth is not None
        return maps.depth

    maps = ij.render(ij.Cylinder(center, axis, radius, height), camera)
    assert maps.normal is not None
    row, col = camera.frame.pixels()
    d = camera.rays(row, col, maps.normal.dtype).direction.stack()
    cosine = -jnp.sum(maps.normal * d, axis=-1) / jnp.linalg.norm(d, axis=-1)
    columns = jax.jacfwd(depth)(jnp.zeros(7))
    return jnp.where(jnp.isfinite(columns), columns, 0), jnp.abs(cosine)
