"""How far an estimate is from the truth, and the Cramér-Rao bound of that."""

__all__ = ["COORDINATES", "bound", "error", "joint_bound"]

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import impostor_jax as ij
from experiments.scenes import CAMERA, Shape, View
from impostor_jax.evaluate import difference
from impostor_jax.fit.body import Rays
from impostor_jax.fit.fittable import KINDS
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.primitives.base import in_camera_frame
from impostor_jax.primitives.tube import as_tube


def error(estimate: Shape, truth: Shape) -> Float[np.ndarray, " k"]:
    """Estimate less truth, in the coordinates of `Fit.covariance`, about the truth.

    Of a frustum its wall: axis and center across it, radius beside the true center and
    slope. Depths tell little of an end that faces away.
    """
    off = difference(estimate, truth, about_found=False, ends_seen=False)
    if not isinstance(truth, ij.Frustum):
        return off
    first, second = off[5:7]
    height = np.linalg.norm(np.asarray(truth.p2, float) - np.asarray(truth.p1, float))
    return np.array([*off[:4], (first + second) / 2, (second - first) / height])


def bound(
    view: View, least_cosine: float = 0.0, reachable: bool = False
) -> Float[np.ndarray, " k"]:
    """Least standard deviation of any unbiased estimate, in the coordinates of `error`.

    From the exact derivatives of all depths of the mask, in double precision, with the
    mask given; `inf` for coordinates that the depths leave free. Where a ray grazes the
    wall, its depth n - h changes without bound with the half-chord h, and the bound
    counts on that, though noise as large as h blurs it.

    Args:
        view: The image.
        least_cosine: Pixels seen at a smaller cosine of incidence are left out.
        reachable: Whether a reading counts for what its square tells of h^2, with the
            variance 4 h^2 sigma^2 + 2 sigma^4 that this has.
    """
    return joint_bound([view], [CAMERA], least_cosine, reachable)


def joint_bound(
    views: Sequence[View],
    cameras: Sequence[ij.AbstractCamera],
    least_cosine: float = 0.0,
    reachable: bool = False,
) -> Float[np.ndarray, " k"]:
    """The same of several images of one shape, which is in the world frame.

    Args:
        views: The images.
        cameras: Of each.
        least_cosine: As of `bound`, like the next.
        reachable: Likewise.
    """
    found = []
    for view, camera in zip(views, cameras, strict=True):
        with jax.enable_x64(True):
            exact, by = jax.tree.map(
                lambda x: np.asarray(x, np.float64), (view.shape, camera)
            )
            columns, cosine, half = (np.asarray(x) for x in _derivatives(exact, by))
        used = view.mask & (cosine >= least_cosine)
        sigma = np.broadcast_to(np.asarray(view.sigma, float), used.shape)
        sigma = sigma[used][:, None]
        columns, half = columns[used] / sigma, half[used][:, None]
        if reachable:
            columns = columns * half / np.sqrt(half**2 + sigma**2 / 2)
        found.append(columns)
    jacobian = np.concatenate(found)
    # A frustum's ends are unknown, too, and not compared.
    count = 6 if isinstance(views[0].shape, ij.Frustum) else jacobian.shape[1]
    return _least_deviation(jacobian)[:count]


def _least_deviation(jacobian: Float[np.ndarray, "n k"]) -> Float[np.ndarray, " k"]:
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
def _derivatives(shape: Shape, camera: ij.AbstractCamera):
    """Of the depths, in the shape's coordinates; cosines of incidence; half-chords.

    A half-chord is half the stretch of a ray within the wall, in depth; very long on
    caps.
    """
    count, moved = COORDINATES[type(shape)]

    def depth(move: Float[Array, " k"]) -> Float[Array, "h w"]:
        maps = ij.render(moved(shape, move), camera, outputs=("depth",))
        assert maps.depth is not None
        return maps.depth

    columns = jax.jacfwd(depth)(jnp.zeros(count))
    maps = ij.render(shape, camera)
    assert maps.normal is not None
    body = in_camera_frame(KINDS[type(shape)].body.of(shape), camera)
    rays = camera.rays(*camera.frame.pixels(), maps.normal.dtype).direction
    d, seen = rays.stack(), body.passing(Rays(rays))
    cosine = jnp.abs(jnp.sum(maps.normal * d, axis=-1)) / jnp.linalg.norm(d, axis=-1)
    half = jnp.where(seen.on_cap, 1e9, jnp.sqrt(jnp.maximum(seen.square, 0)))
    return jnp.where(jnp.isfinite(columns), columns, 0), cosine, half


def _moved_cylinder(can: ij.Cylinder, move: Float[Array, "7"]) -> ij.Cylinder:
    basis = tangent_basis(can.axis)
    return ij.Cylinder(
        can.center + basis.T @ move[2:4] + can.axis * move[4],
        can.axis + basis.T @ move[:2],
        can.radius + move[5],
        can.height + move[6],
    )


def _moved_sphere(ball: ij.Sphere, move: Float[Array, "4"]) -> ij.Sphere:
    return ij.Sphere(ball.center + move[:3], ball.radius + move[3])


def _moved_frustum(cup: ij.Frustum, move: Float[Array, "8"]) -> ij.Frustum:
    """Its wall moved by the first six, its ends along the axis by the others."""
    height = jnp.linalg.norm(cup.p2 - cup.p1)
    basis = tangent_basis(cup.axis)
    axis = cup.axis + basis.T @ move[:2]
    center = (cup.p1 + cup.p2) / 2 + basis.T @ move[2:4]
    radius = (cup.radius1 + cup.radius2) / 2 + move[4]
    slope = (cup.radius2 - cup.radius1) / height + move[5]
    low, high = -height / 2 + move[6], height / 2 + move[7]
    ends = center + axis * low, center + axis * high
    return ij.Frustum(*ends, radius + slope * low, radius + slope * high)


def _moved_tube(tube: ij.Solid, move: Float[Array, "8"]) -> ij.Solid:
    own = as_tube(tube)
    basis = tangent_basis(own.axis)
    return ij.tube(
        own.center + basis.T @ move[2:4] + own.axis * move[4],
        own.axis + basis.T @ move[:2],
        own.outer_radius + move[5],
        own.inner_radius + move[6],
        own.height + move[7],
    )


COORDINATES: dict[type[Shape], tuple[int, Callable[..., Shape]]] = {
    ij.Cylinder: (7, _moved_cylinder),
    ij.Sphere: (4, _moved_sphere),
    ij.Frustum: (8, _moved_frustum),
    ij.Solid: (8, _moved_tube),
}
"""Number of a shape's coordinates, and the shape that they move it to."""
