"""The outline as a closed curve in the image, also where the true one is not bounded.

What lies behind the camera's plane z = 0 is pulled along straight lines, which stay in
the convex solid, towards the solid's deepest point until it is in front. What lies far
outside the image is pulled towards the optical axis. Both keep the curve closed, and on
the same side of every pixel. So a body that reaches behind the camera needs no
formulas of its own, and a lens polynomial is not used where it folds back.
"""

__all__ = ["ImageCurve", "Steps", "image_curve"]

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float

from impostor_jax.camera.base import AbstractCamera, check_planar
from impostor_jax.camera.pixels import Tile
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.rendering.outline_base import AbstractOutline, Place
from impostor_jax.rendering.outline_curve import outline
from impostor_jax.rendering.polygon import running_sum

PASSES = 4
"""How often steps along the curve are evened out, each time from the steps before."""
BORDER = 0.02
"""Width of the ring that holds what lies too far outside, as part of its radius."""


class Steps(eqx.Module):
    """Points of the curve in order.

    Attributes:
        parameter: Of the outline.
        place: Of the points on the body.
        pixels: Image coordinates (u, v).
        pulled: Whether (u, v) is not the point's own image but that of where it was
            pulled, far outside the tile.
    """

    parameter: Float[Array, " n"]
    place: Place
    pixels: Float[Array, "n 2"]
    pulled: Bool[Array, " n"]


class ImageCurve(eqx.Module):
    """Image of an outline.

    Attributes:
        outline: The curve in space.
        camera: The camera.
        tile: Block of pixels in and around which the curve is exact.
        deepest: Point of the solid with the largest depth.
        near: Depth in front of which nothing is seen in the tile, in meters.
        limit: Square of the distance from the optical axis, in the plane z = 1, beyond
            which nothing is seen in the tile.
        visible: Whether there is an outline in front of the camera.
    """

    outline: AbstractOutline
    camera: AbstractCamera
    tile: Tile
    deepest: Vec3
    near: Float[Array, ""]
    limit: Float[Array, ""]
    visible: Bool[Array, ""]

    def at(self, parameter: Float[Array, " n"]) -> Steps:
        """Points of the curve at parameters of the outline; without a derivative."""
        still = jax.lax.stop_gradient(self)
        place = still.outline.place(parameter)
        point = still.outline.point(*place)
        x, y, z = point[:, 0], point[:, 1], point[:, 2]
        # Nothing here is differentiated, so limits may come from a quotient by zero.
        depth = jnp.maximum(still.deepest.z - z, jnp.finfo(z.dtype).tiny)
        pull = jnp.clip((still.near - z) / depth, 0, 1)
        x = x + pull * (still.deepest.x - x)
        y = y + pull * (still.deepest.y - y)
        z = jnp.maximum(z, still.near)
        # All that is farther than the limit comes to lie between it and a little more,
        # the farther the farther: on one circle the curve could not tell its two sides.
        inner = jnp.sqrt(still.limit * z * z / (x * x + y * y))
        shrink = jnp.where(inner < 1, inner * (1 + BORDER * (1 - inner)), 1)
        points = Vec3(x * shrink, y * shrink, z).stack()
        pixels = still.camera.project(points)
        return Steps(parameter, place, pixels, (pull > 0) | (shrink < 1))

    def even_steps(self, count: int, margin: int) -> Steps:
        """Points a step apart on the closed curve; without a derivative.

        Args:
            count: Number of steps, a multiple of 32.
            margin: Pixels around the tile in which steps are wanted; none are spent on
                what lies outside.
        """
        tile, dtype = self.tile, self.near.dtype
        corner = jnp.stack([jnp.asarray(tile.col), jnp.asarray(tile.row)]).astype(dtype)
        far = corner + np.array([tile.width - 1, tile.height - 1], dtype)
        index = jnp.arange(count, dtype=dtype)
        tiny = float(np.sqrt(jnp.finfo(dtype).tiny))
        # The first turn only takes equal parameters. They may jump over all of a small
        # tile, so the next two look farther.
        size = tile.height + tile.width
        margins = jnp.array([0, 4 * size, size] + [0] * (PASSES - 2), dtype) + margin

        def spread(i: Array, steps: Steps) -> Steps:
            low, high = (corner - margins[i])[None], (far + margins[i])[None]
            points = jnp.clip(steps.pixels, low, high)
            way = jnp.roll(points, -1, axis=0) - points
            length = jnp.sqrt(way[:, 0] * way[:, 0] + way[:, 1] * way[:, 1])
            length = jnp.maximum(length, tiny)
            walked = running_sum(length)
            # Each new point lies in the last stretch that starts before it.
            step = walked[-1] / count
            start = (walked - length) / step
            first = jnp.minimum(jnp.ceil(start), count - 1).astype(int)
            begins = jnp.zeros(count, dtype).at[first].add(1)
            stretch = running_sum(begins).astype(int) - 1
            part = (index - start[stretch]) * step / length[stretch]
            width = jnp.append(steps.parameter[1:], 4) - steps.parameter
            parameter = steps.parameter[stretch] + jnp.clip(part, 0, 1) * width[stretch]
            return self.at(jnp.where(i == 0, index * (4 / count), parameter))

        nothing = jnp.zeros(count, dtype)
        nowhere = Steps(
            nothing, (nothing, nothing, nothing), jnp.zeros((count, 2), dtype),
            jnp.zeros(count, bool),
        )  # fmt: skip
        return jax.lax.fori_loop(0, PASSES + 1, spread, nowhere)

    def followed(self, steps: Steps) -> Float[Array, "n 2"]:
        """Image coordinates (u, v) of points of the curve.

        Derivatives:
            In the body and in the camera: each point moves with the body. 0 where
            it was pulled.
        """
        points = self.outline.point(*steps.place)
        pulled = steps.pulled[:, None]
        forward = jnp.array([[0, 0, 1]], points.dtype)
        pixels = self.camera.project(jnp.where(pulled, forward, points))
        return jnp.where(pulled, steps.pixels, pixels)

    def tangent(self, steps: Steps) -> Float[Array, "n 2"]:
        """Direction in which the curve runs in the image; without a derivative.

        It means nothing where a point was pulled.
        """
        still = jax.lax.stop_gradient(self)
        points = still.outline.point(*steps.place)
        forward = jnp.array([[0, 0, 1]], points.dtype)
        points = jnp.where(steps.pulled[:, None], forward, points)
        along = still.outline.tangent(steps.parameter)
        return jax.jvp(still.camera.project, (points,), (along,))[1]


def image_curve(
    primitive: AbstractPrimitive,
    camera: AbstractCamera,
    tile: Tile,
    reach: float = 1.1,
) -> ImageCurve:
    """Curve of a shape's outline in a camera's image.

    Args:
        primitive: A single one with an `outline`, in the world frame.
        camera: The camera.
        tile: Block of pixels that matters.
        reach: How far the curve is exact: times as far from the optical axis, in the
            plane z = 1, as the tile sees. A lens polynomial folds back not much beyond.
    """
    curve = outline(primitive, camera)
    check_planar(camera)
    limit = _limit(camera, tile, reach, curve.radius.dtype)
    deepest = curve.deepest
    # No point of the solid is nearer than this. One whose depth is a small part of it
    # is seen far from the optical axis, or not at all.
    away = jnp.maximum(curve.clearance, eps(limit.dtype) * curve.radius)
    near = away / (8 + 4 * limit)
    visible = ~curve.inside & (deepest.z > near)
    return ImageCurve(
        curve, camera, tile, *jax.lax.stop_gradient((deepest, near, limit, visible))
    )


def _limit(
    camera: AbstractCamera, tile: Tile, reach: float, dtype: DTypeLike
) -> Float[Array, ""]:
    """Square of the distance from the optical axis that `reach` stands for."""
    row, col = tile.pixels()
    d = camera.rays(row, col, dtype).direction
    square = d.x * d.x + d.y * d.y
    sees = camera.sees(row, col)
    if sees is not None:
        square = jnp.where(sees, square, 0)
    axis, across = jnp.array([[0, 0, 1], [1, 0, 0]], dtype)
    _, per_unit = jax.jvp(camera.project, (axis,), (across,))
    # Never less than two pixels more, since a tile may be a single pixel on the axis:
    # (a + 2 b)^2 <= 1.21 a^2 + 23 b^2.
    return reach**2 * jnp.max(square) + 23 / jnp.sum(per_unit * per_unit)
