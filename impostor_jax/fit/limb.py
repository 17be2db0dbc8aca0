"""Where the surface beside the outline of a wall ends in an image.

A region's edge alone is no outline, for an occluder, the image's border and a mask that
is drawn too small end it, too. So a place along the wall counts only where background
follows, clearly farther away, or where the caller says that the mask is the outline.
"""

__all__ = ["Limb", "limb_of"]

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.pose import in_double
from impostor_jax.fit.seen import Seen
from impostor_jax.primitives.cylinder import Cylinder

BEHIND = 0.5
"""Radii behind the wall's outline beyond which a reading is of the background. A wall
that is a quarter larger than the fit's, with its front in the same place, ends a
quarter of a radius behind."""

JUMP = 0.25
"""Radii in depth from the surface to the background beside it. A table that recedes
from where an object stands has no such jump."""

BORDER = 0.25
"""Radii of the surface beside the mask that may be the object's, if background follows:
masks of cans were drawn up to a fifth of a radius inside of the outline."""

STEPS = np.linspace(-1.0, 1.5, 81)
"""Where the surface may end, in radii beyond the outline: each 32nd of a radius."""

LASTING = 2.0
"""Pixels over which there must be background: one reading may be an outlier."""


class Limb(NamedTuple):
    """What an image shows beside the two sides of a wall, place by place along it.

    Lengths are in radii, from the wall's outline outward.

    Attributes:
        surface: Where the surface is seen last.
        background: Where the background is seen first.
        shown: Whether the place shows the outline.
        pixels: Of the image in a radius, beside each side's middle.
        normal: Of the planes through the camera that touch the sides, outward, in the
            world frame.
    """

    surface: Float[np.ndarray, "2 s"]
    background: Float[np.ndarray, "2 s"]
    shown: Bool[np.ndarray, "2 s"]
    pixels: Float[np.ndarray, "2"]
    normal: Float[np.ndarray, "2 3"]

    @property
    def gap(self) -> Float[np.ndarray, "2 s"]:
        """How far the image's outline is beyond the wall's, at least; < 0 within it."""
        return np.maximum(self.surface, 0) + np.minimum(self.background, 0)


def limb_of(
    body: Cylinder,
    seen: Seen,
    along: Float[np.ndarray, " s"],
    slack: float,
    is_outline: bool = False,
) -> Limb | None:
    """What an image shows beside a wall; None from within, or without a pinhole camera.

    Args:
        body: The wall, in the world frame.
        seen: The object in the image.
        along: Places along the wall, in heights from its center.
        slack: Depth that the background is farther than the outline, beside what
            `BEHIND` says, in meters.
        is_outline: Whether the region's edge is the silhouette.
    """
    camera = seen.camera
    if not isinstance(camera, PinholeCamera):
        return None
    rotation, shift = in_double(camera.camera_from_world)
    radius, wall = float(body.radius), _wall(body, along, rotation, shift)
    if wall is None:
        return None
    normal, limb = wall
    points = normal[:, None, None] * (radius * STEPS)[:, None] + limb[:, :, None]
    if points[..., 2].min() <= 0:
        return None
    places = _projected(points, camera)
    behind = limb[..., 2] + BEHIND * radius + slack
    bounds = _bounds(seen, behind, JUMP * radius, places, is_outline)
    ends = places[:, len(along) // 2, [0, -1]]
    pixels = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1) / (STEPS[-1] - STEPS[0])
    return Limb(*bounds, pixels, normal @ rotation)


def _wall(
    body: Cylinder,
    along: Float[np.ndarray, " s"],
    rotation: Float[np.ndarray, "3 3"],
    shift: Float[np.ndarray, "3"],
) -> tuple[Float[np.ndarray, "2 3"], Float[np.ndarray, "2 s 3"]] | None:
    """Outward normals of the planes through a camera that touch a wall, and where.

    In the camera frame; None from within.
    """
    center = rotation @ np.asarray(body.center, np.float64) + shift
    axis = rotation @ np.asarray(body.axis, np.float64)
    axis /= np.linalg.norm(axis)
    across = center - axis * (center @ axis)
    distance, radius = float(np.linalg.norm(across)), float(body.radius)
    if distance <= radius:
        return None
    away = across / distance
    sine = radius / distance
    side = np.array([[-1.0], [1.0]]) * np.sqrt(1 - sine**2)
    normal = side * np.cross(axis, away) - sine * away
    places = float(body.height) * along[:, None] * axis
    return normal, center + radius * normal[:, None] + places


def _bounds(
    seen: Seen,
    behind: Float[np.ndarray, "2 s"],
    jump: float,
    places: Float[np.ndarray, "2 s t 2"],
    is_outline: bool,
) -> tuple[Float[np.ndarray, "2 s"], Float[np.ndarray, "2 s"], Bool[np.ndarray, "2 s"]]:
    """Where the surface is seen last and the background first, in radii.

    And whether each place, which leads outward by `STEPS`, shows the outline. The
    background lies `behind` that depth, and a `jump` from the last of the surface.
    """
    height, width = seen.image.shape
    col, row = np.rint(places[..., 0]), np.rint(places[..., 1])
    inside = (row >= 0) & (row < height) & (col >= 0) & (col < width)
    at = np.where(inside, row * width + col, 0).astype(np.intp)
    masked = inside & seen.region.ravel()[at]
    depth = np.where(inside, seen.image.ravel()[at], 0)
    step, farthest = np.arange(STEPS.size), behind[..., None]
    near = (depth > 0) & (depth < farthest)
    last = _last(masked if is_outline else masked & near)
    far = inside & ~masked if is_outline else _lasting(depth > farthest, places)
    # Background amid the surface is an outlier, or seen through a hole.
    far &= step > last[..., None]
    first, follows = np.argmax(far, axis=-1), far.any(axis=-1)
    shown = (last >= 0) & follows
    if not is_outline:
        end = _last(near & (step < first[..., None]))
        last = np.where(STEPS[end] - STEPS[last] < BORDER, end, last)
        side, place = np.ix_(*map(np.arange, last.shape))
        before, after = depth[side, place, last], depth[side, place, first]
        shown &= after - before > jump
        until = np.where(follows, first, STEPS.size)
        between = (step > last[..., None]) & (step < until[..., None])
        # What lies in front of the surface hides where that ends. Of a side that is
        # mostly hidden, outliers before the occluder would be left.
        in_front = between & (depth > 0) & (depth < before[..., None] - jump)
        is_hidden = in_front.any(axis=-1)
        shown &= ~is_hidden
        is_side_hidden = np.sum(is_hidden, axis=1) >= np.sum(shown, axis=1)
        shown &= ~is_side_hidden[:, None]
    return STEPS[last], STEPS[first], shown


def _lasting(
    marks: Bool[np.ndarray, "2 s t"], places: Float[np.ndarray, "2 s t 2"]
) -> Bool[np.ndarray, "2 s t"]:
    """Marks that are followed by another `LASTING` pixels on: no single outliers."""
    pixels = np.abs(places[0, 0, -1] - places[0, 0, 0]).max() / (STEPS.size - 1)
    ahead = int(np.clip(np.ceil(LASTING / max(pixels, 1e-9)), 1, STEPS.size - 1))
    marks[..., :-ahead] &= marks[..., ahead:]
    marks[..., -ahead:] = False
    return marks


def _last(marks: Bool[np.ndarray, "2 s t"]) -> Int[np.ndarray, "2 s"]:
    """Last step that is marked at each place; -1 where none is."""
    return np.where(marks, np.arange(marks.shape[-1]), -1).max(axis=-1)


def _projected(
    points: Float[np.ndarray, "2 s t 3"], camera: PinholeCamera
) -> Float[np.ndarray, "2 s t 2"]:
    """Columns and rows of points."""
    if camera.distortion is not None:
        # Always of one size: compiled once.
        dtype = camera.distortion.dtype
        return np.asarray(_through_lens(points.astype(dtype), camera), np.float64)
    scale = np.array([float(camera.fx), float(camera.fy)])
    middle = np.array([float(camera.cx), float(camera.cy)])
    return points[..., :2] / points[..., 2:] * scale + middle


@jax.jit
def _through_lens(
    points: Float[Array, "2 s t 3"], camera: PinholeCamera
) -> Float[Array, "2 s t 2"]:
    return camera.project(points)
