"""What a fit is given, gathered from images: all that its programs pass around.

Each image is a view, and what it tells is computed in the frame of its own camera. The
estimate lives in the frame of the first, which is the camera's where there is but one.
"""

__all__ = [
    "BLOCK",
    "MAX_CROSSINGS",
    "Edge",
    "Pixels",
    "Problem",
    "Settings",
    "Shown",
    "View",
    "gather_pixels",
    "posed",
    "sigma_of",
]

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.camera.ray_table import RayTable, Sight
from impostor_jax.fit.body import AbstractBody, FreeDirections
from impostor_jax.fit.prior import Prior
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import Numbers, eps, product
from impostor_jax.primitives.base import in_world_frame
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.bias import Bias

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
        start: Where the rays begin; None where all begin at the origin.
        length: Distance along a ray over depth, where a sensor measures that; None of
            depths.
        is_image: Whether they were chosen by their rays, as by a mask; points in any
            order are by where they lie.
    """

    direction: Vec3
    depth: Float[Array, "*batch"]
    exists: Bool[Array, "*batch"]
    start: Vec3 | None = None
    length: Float[Array, "*batch"] | None = None
    is_image: bool = eqx.field(static=True, default=True)


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
        one_sensor: Whether one sensor took all images: they share the error of its
            scale.
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
    one_sensor: bool | Bool[Array, ""]
    held: dict[str, bool | Bool[Array, ""]]


class Shown(NamedTuple):
    """An object in an image.

    Attributes:
        depth: In meters; 0 where there is no reading.
        mask: Pixels of the object.
        row: Rows of the object's pixels, as `pixel_indices` orders them; one beyond the
            image only fills up.
        col: Columns of the object's pixels.
        camera: That took the image.
        noise: Of its readings.
    """

    depth: Float[Array, "h w"] | Float[np.ndarray, "h w"]
    mask: Bool[Array, "h w"] | Bool[np.ndarray, "h w"]
    row: Int[Array, " n"] | Int[np.ndarray, " n"]
    col: Int[Array, " n"] | Int[np.ndarray, " n"]
    camera: Sight
    noise: AbstractDepthNoise


class View(eqx.Module):
    """What an image shows of an object, in the frame of its camera.

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
        pixel: Distance of neighboring rays over the depth.
        camera: That took the image.
        from_first: To its frame from that of the first view; None where they are one.
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
    pixel: Float[Array, ""]
    camera: Sight
    from_first: RigidTransform | None

    @property
    def length(self) -> Float[Array, " n"]:
        """Distance that the sensor measures along the rays of pixels, over depth."""
        pixels = self.pixels
        return jnp.ones_like(pixels.depth) if pixels.length is None else pixels.length

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns of the image."""
        return self.camera.height, self.camera.width

    def own(self, body: AbstractBody) -> AbstractBody:
        """A body of the first view's frame in that of this one."""
        return body if self.from_first is None else body.transformed(self.from_first)

    def told(
        self, terms: Float[Array, "k n"], body: AbstractBody
    ) -> Float[Array, "k n"]:
        """Gradients and residuals in tangent coordinates of the first view's frame.

        Args:
            terms: In those of the `own` body, as of `Terms.augmented`.
            body: In the first view's frame.
        """
        if self.from_first is None:
            return terms
        return product(self._into(body), terms)

    def products_told(
        self, products: Float[Array, "k k"], body: AbstractBody
    ) -> Float[Array, "k k"]:
        """The same of products of such terms, summed up."""
        if self.from_first is None:
            return products
        into = self._into(body)
        return product(into, products, into.T)

    def _into(self, body: AbstractBody) -> Float[Array, "k k"]:
        assert self.from_first is not None
        carried = body.carried(self.from_first)
        return jnp.pad(carried, ((0, 1), (0, 1))).at[-1, -1].set(1)


class Problem(eqx.Module):
    """A fit's views, what is known of the object, and what is asked.

    Attributes:
        views: At least one.
        prior: In the frame of the first view.
        nominal: Typical standard deviation of a reading, in meters.
        unit: Ten standard deviations of a position that all readings share, in meters.
        end_unit: The same of the ends, which are known to part of a pixel if not by
            the readings of a cap.
        settings: What is asked for.
        kernel: Name of the robust loss.
    """

    views: tuple[View, ...]
    prior: Prior
    nominal: Float[Array, ""]
    unit: Float[Array, ""]
    end_unit: Float[Array, ""]
    settings: Settings
    kernel: str = eqx.field(static=True)

    @property
    def is_single(self) -> bool:
        """Whether there is one view."""
        return len(self.views) == 1

    @property
    def is_central(self) -> bool:
        """Whether all rays begin in one place, from which a scale looks like a size."""
        return self.is_single and self.views[0].pixels.start is None

    @property
    def bias(self) -> Bias:
        """Of the sensor, if all rays begin in one place; none otherwise."""
        return self.views[0].noise.bias if self.is_central else Bias()

    def in_world(self, body: AbstractBody) -> AbstractBody:
        """A body of the first view's frame in that of the world."""
        return in_world_frame(body, self.views[0].camera)

    def apart(self, values: Array) -> list[Array]:
        """Values of all readings, view by view."""
        sizes = [view.row.shape[0] for view in self.views]
        return jnp.split(values, np.cumsum(sizes)[:-1], axis=-1)


def posed(
    shown: tuple[Shown, ...], prior: Prior, settings: Settings, kernel: str
) -> Problem:
    """Gather the problem of an object in some images.

    Args:
        shown: The object in each of them.
        prior: In the world frame.
        settings: What is asked for.
        kernel: Name of the robust loss.
    """
    first = shown[0].camera
    views = tuple(_view_of(one, None if one is shown[0] else first) for one in shown)
    dtype = views[0].pixels.depth.dtype
    counts, weights, footprints = zip(*map(_summed, views), strict=True)
    count = jnp.maximum(sum(counts[1:], counts[0]), 1).astype(dtype)
    nominal = count / jnp.maximum(sum(weights[1:], weights[0]), 1e-6)
    unit = 10 * nominal / jnp.sqrt(count)
    footprint = sum(footprints[1:], footprints[0]) / count
    numbers = [jnp.asarray(x, dtype) for x in (settings.free, settings.tolerance)]
    settings = eqx.tree_at(lambda s: (s.free, s.tolerance), settings, tuple(numbers))
    return Problem(
        views=views,
        prior=prior.in_camera_frame(first),
        nominal=nominal,
        unit=unit,
        end_unit=jnp.maximum(unit, footprint / 20),
        settings=settings,
        kernel=kernel,
    )


def _view_of(shown: Shown, first: Sight | None) -> View:
    """The view of an image.

    Args:
        shown: The object in it.
        first: Camera of the first view, where this is another.
    """
    mask, row, col = map(jnp.asarray, (shown.mask, shown.row, shown.col))
    depth, camera = jnp.asarray(shown.depth), shown.camera
    depth = depth.astype(jnp.result_type(float))
    start = jnp.argmax(row < depth.shape[0]).astype(jnp.int32)
    around, each = _spread_pixels(depth, mask, camera)
    return View(
        pixels=gather_pixels(depth, camera, row, col),
        num_blocks=-(-(row.shape[0] - start) // BLOCK),
        edge=_gather_edge(depth, mask, camera, row, col),
        around=around,
        each=each,
        row=row,
        col=col,
        mask=mask,
        noise=shown.noise,
        pixel=jnp.asarray(camera.spacing).astype(depth.dtype),
        camera=camera,
        from_first=None if first is None else _from_first(first, camera),
    )


def _from_first(first: Sight, other: Sight) -> RigidTransform:
    """To the frame of a camera from that of the first."""
    moves = [
        camera.camera_from_world or RigidTransform(np.eye(3), np.zeros(3))
        for camera in (first, other)
    ]
    return moves[1] @ moves[0].inverse()


def _summed(view: View) -> tuple[Int[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """Of a view's readings their number, and sums of inverse deviations and widths."""
    pixels = view.pixels
    used = pixels.depth > 0
    sigma = sigma_of(view.noise, pixels, pixels.depth, jnp.ones_like(pixels.depth))
    weight = jnp.sum(jnp.where(used, 1 / sigma, 0))
    return jnp.sum(used), weight, jnp.sum(pixels.depth) * view.pixel


def gather_pixels(
    depth: Float[Array, "h w"],
    camera: Sight,
    row: Int[Array, "*batch"],
    col: Int[Array, "*batch"],
) -> Pixels:
    """Collect what the image holds at some pixels; beyond it there is no reading."""
    exists = _in_image(row, col, depth.shape)
    row, col = jnp.where(exists, row, 0), jnp.where(exists, col, 0)
    rays = camera.rays(row, col, depth.dtype)
    return Pixels(
        direction=rays.direction,
        depth=jnp.where(exists, depth[row, col], 0),
        exists=exists,
        start=None if camera.is_central else rays.origin,
        length=rays.direction.norm() if isinstance(camera, RayTable) else None,
        is_image=not isinstance(camera, RayTable) or camera.is_image,
    )


def _gather_edge(
    depth: Float[Array, "h w"],
    mask: Bool[Array, "h w"],
    camera: Sight,
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
    depth: Float[Array, "h w"], mask: Bool[Array, "h w"], camera: Sight
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
    noise: AbstractDepthNoise, pixels: Pixels, depth: Numbers, cos_incidence: Numbers
) -> Numbers:
    """What the sensor says, but no less than depths are rounded to.

    With 4 eps in place of 16 an eighth of 24 rendered cans ran to the step limit, after
    140 steps on average: steps are then of the size of roundings.

    Args:
        noise: Of the sensor.
        pixels: Whose readings they are.
        depth: Of the surface there, in meters.
        cos_incidence: Cosine between surface normal and ray.
    """
    if pixels.length is None:
        sigma = noise.sigma(depth, cos_incidence)
    else:
        # What errs along the ray.
        sigma = noise.sigma(depth * pixels.length, cos_incidence) / pixels.length
    return jnp.maximum(sigma, eps(depth.dtype, 16) * depth)
