"""What a fit is given, gathered from an image: all that its programs pass around."""

__all__ = [
    "BLOCK",
    "MAX_CROSSINGS",
    "Edge",
    "Pixels",
    "Problem",
    "Settings",
    "gather_pixels",
    "posed",
    "sigma_of",
]

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.body import FreeDirections
from impostor_jax.fit.prior import Prior
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.sensor.base import AbstractDepthNoise

BLOCK = 512
"""Readings that are summed at a time; the last of them, which are evenly spread over
the object, speak for all."""

MAX_CROSSINGS = 512
"""Most pixels at the object's edge that are looked at, spread over all of it."""

SPREAD = 64
"""Pixels along each side of the image that tell what a solution would hide."""


class Pixels(eqx.Module):
    """What the image holds at some pixels.

    Attributes:
        direction: Of the rays, in the camera frame, with z = 1.
        depth: In meters; 0 where there is no reading.
        exists: False beyond the image, and for entries that only fill up.
    """

    direction: Vec3
    depth: Float[Array, "*batch"]
    exists: Bool[Array, "*batch"]


class Edge(eqx.Module):
    """Pixels of the object at its edge: itself, left, right, above and below.

    Attributes:
        pixels: What the image holds there.
        inside: Which of them belong to the object.
    """

    pixels: Pixels
    inside: Bool[Array, "5 m"]


class Settings(eqx.Module):
    """What is asked for that is compiled once for all answers.

    Attributes:
        free: As `AbstractBody.free_directions` returns it.
        tolerance: Of an `Effort`, in standard deviations.
        max_steps: Of an `Effort`.
        is_outline: Whether the mask's edge is the silhouette.
        estimate_scale: Whether the width of the robust loss follows the residuals.
        keep_ends: Whether the ends keep their names; otherwise the axis is signed.
        trusts_sigma: Whether the noise is what the caller says, and not a guess.
        refutes: Whether a border that contradicts the rest is a failure.
        draws_in: Whether an end that is not seen is put where the wall was last seen.
        held: Whether each parameter is held, by its name.
    """

    free: FreeDirections
    tolerance: float | Float[Array, ""]
    max_steps: int | Int[Array, ""]
    is_outline: bool | Bool[Array, ""]
    estimate_scale: bool | Bool[Array, ""]
    keep_ends: bool | Bool[Array, ""]
    trusts_sigma: bool | Bool[Array, ""]
    refutes: bool | Bool[Array, ""]
    draws_in: bool | Bool[Array, ""]
    held: dict[str, bool | Bool[Array, ""]]


class Problem(eqx.Module):
    """A fit's readings in the camera frame, what is known of them, and what is asked.

    Attributes:
        pixels: Of the object; those that only fill up come first.
        num_blocks: Blocks of them, from the end, that hold a reading.
        edge: Where the object may stop.
        around: Pixels all over the image, with no reading on the object.
        each: How many pixels one of those stands for.
        row: Rows of the pixels; one beyond the image only fills up.
        col: Columns of the pixels.
        mask: Pixels of the object.
        noise: Of the readings.
        prior: In the camera frame.
        nominal: Typical standard deviation of a reading, in meters.
        unit: Ten standard deviations of a position that all readings share, in meters.
        pixel: Distance of neighboring rays over the depth.
        end_unit: The same of the ends, which are known to part of a pixel if not by
            the readings of a cap.
        settings: What is asked for.
        camera: That took the image.
        kernel: Name of the robust loss.
    """

    pixels: Pixels
    num_blocks: Int[Array, ""]
    edge: Edge
    around: Pixels
    each: float | Float[Array, ""]
    row: Int[Array, " n"]
    col: Int[Array, " n"]
    mask: Bool[Array, "h w"]
    noise: AbstractDepthNoise
    prior: Prior
    nominal: Float[Array, ""]
    unit: Float[Array, ""]
    pixel: Float[Array, ""]
    end_unit: Float[Array, ""]
    settings: Settings
    camera: PinholeCamera
    kernel: str = eqx.field(static=True)


def posed(
    depth: Float[Array, "h w"],
    mask: Bool[Array, "h w"],
    row: Int[Array, " n"],
    col: Int[Array, " n"],
    camera: PinholeCamera,
    noise: AbstractDepthNoise,
    prior: Prior,
    settings: Settings,
    kernel: str,
) -> Problem:
    """Gather the problem of an image.

    Args:
        depth: In meters; 0 where there is no reading.
        mask: Pixels of the object.
        row: Rows of the object's pixels, as `pixel_indices` orders them; one beyond the
            image only fills up.
        col: Columns of the object's pixels.
        camera: The camera.
        noise: Of its readings.
        prior: In the world frame.
        settings: What is asked for.
        kernel: Name of the robust loss.
    """
    depth = depth.astype(jnp.result_type(float))
    pixels = gather_pixels(depth, camera, row, col)
    used = pixels.depth > 0
    count = jnp.maximum(jnp.sum(used), 1).astype(depth.dtype)
    sigma = sigma_of(noise, pixels.depth, jnp.ones_like(pixels.depth))
    nominal = count / jnp.maximum(jnp.sum(jnp.where(used, 1 / sigma, 0)), 1e-6)
    unit = 10 * nominal / jnp.sqrt(count)
    pixel = 1 / jnp.minimum(camera.fx, camera.fy).astype(depth.dtype)
    footprint = jnp.sum(pixels.depth) / count * pixel
    first = jnp.argmax(row < depth.shape[0]).astype(jnp.int32)
    around, each = _spread_pixels(depth, mask, camera)
    numbers = [jnp.asarray(x, depth.dtype) for x in (settings.free, settings.tolerance)]
    settings = eqx.tree_at(lambda s: (s.free, s.tolerance), settings, tuple(numbers))
    return Problem(
        pixels=pixels,
        num_blocks=-(-(row.shape[0] - first) // BLOCK),
        edge=_gather_edge(depth, mask, camera, row, col),
        around=around,
        each=each,
        row=row,
        col=col,
        mask=mask,
        noise=noise,
        prior=prior.in_camera_frame(camera),
        nominal=nominal,
        unit=unit,
        pixel=pixel,
        end_unit=jnp.maximum(unit, footprint / 20),
        settings=settings,
        camera=camera,
        kernel=kernel,
    )


def gather_pixels(
    depth: Float[Array, "h w"],
    camera: AbstractCamera,
    row: Int[Array, "*batch"],
    col: Int[Array, "*batch"],
) -> Pixels:
    """Collect what the image holds at some pixels; beyond it there is no reading."""
    exists = _in_image(row, col, depth.shape)
    row, col = jnp.where(exists, row, 0), jnp.where(exists, col, 0)
    return Pixels(
        direction=camera.rays(row, col, depth.dtype).direction,
        depth=jnp.where(exists, depth[row, col], 0),
        exists=exists,
    )


def _gather_edge(
    depth: Float[Array, "h w"],
    mask: Bool[Array, "h w"],
    camera: AbstractCamera,
    row: Int[Array, " n"],
    col: Int[Array, " n"],
) -> Edge:
    """Collect what the image holds at the object's edge."""
    down, right = jnp.array([[0, 0, 0, -1, 1], [0, -1, 1, 0, 0]])[..., None]
    near_row, near_col = row[None] + down, col[None] + right
    exists = _in_image(near_row, near_col, depth.shape)
    inside = mask.at[near_row, near_col].get(mode="clip")
    is_edge = exists[0] & jnp.any(exists & ~inside, axis=0)
    # A fixed shuffle, so that the pixels that are kept lie all around the object.
    order = np.random.default_rng(0).uniform(0.5, 1, row.shape[0])
    priority = jnp.where(is_edge, jnp.asarray(order, depth.dtype), 0)
    priority, chosen = jax.lax.top_k(priority, min(MAX_CROSSINGS, row.shape[0]))
    edge_row = jnp.where((priority > 0)[None], near_row[:, chosen], -1)
    pixels = gather_pixels(depth, camera, edge_row, near_col[:, chosen])
    return Edge(pixels, inside[:, chosen])


def _in_image(
    row: Int[Array, "*batch"], col: Int[Array, "*batch"], shape: tuple[int, ...]
) -> Bool[Array, "*batch"]:
    return (row >= 0) & (row < shape[0]) & (col >= 0) & (col < shape[1])


def _spread_pixels(
    depth: Float[Array, "h w"], mask: Bool[Array, "h w"], camera: PinholeCamera
) -> tuple[Pixels, float]:
    """Pixels all over the image off the object, and how many each stands for."""
    row = np.linspace(0, camera.height - 1, SPREAD).astype(int)
    col = np.linspace(0, camera.width - 1, SPREAD).astype(int)
    row, col = map(np.ravel, np.meshgrid(row, col, indexing="ij"))
    pixels = gather_pixels(depth, camera, jnp.asarray(row), jnp.asarray(col))
    off = jnp.where(mask[row, col], 0, pixels.depth)
    each = camera.height * camera.width / SPREAD**2
    return eqx.tree_at(lambda p: p.depth, pixels, off), each


def sigma_of(
    noise: AbstractDepthNoise,
    depth: Float[Array, "*batch"],
    cos_incidence: Float[Array, "*batch"],
) -> Float[Array, "*batch"]:
    """What the sensor says, but no less than depths are rounded to.

    With 4 eps in place of 16 an eighth of 24 rendered cans ran to the step limit, after
    140 steps on average: steps are then of the size of roundings.
    """
    return jnp.maximum(noise.sigma(depth, cos_incidence), eps(depth.dtype, 16) * depth)
