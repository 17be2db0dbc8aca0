"""How far the outline of a fitted wall is from where the surface ends in the image.

Depth that is skewed fits a cylinder of the wrong radius, and no residual tells. The
outline does: readings of the surface lie beyond it, where their rays miss the wall, or
readings of the background within it, which the wall would hide. Both are bounds: a hole
or a ragged edge between the last reading of the surface and the first of the background
is no gap.

A region's edge alone is no outline, for an occluder, the image's border and a mask that
is drawn too small end it, too. So a place along the wall counts only where background
follows, clearly farther away, or where the caller says that the mask is the outline.
"""

__all__ = ["compared_with_outline"]

import statistics
import warnings
from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.result import LARGE_GAP, Fit, OutlineGap
from impostor_jax.fit.seen import Seen
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.primitives.cylinder import Cylinder

MOST_DEVIATIONS = 5.0
"""Deviations above which a gap is significant: by chance once in 2e6 outlines."""

NOTED = 2.0
"""Deviations of fit and edge alone above which a caller is warned of a gap that the
sensor's way with edges may explain."""

EDGE = 1.0
"""Standard deviation in pixels of where a surface ends in an image. On the same real
images, with a sensor of which nothing is told, it is off by 0 to 2.7 pixels."""

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

NUM_PLACES = 16
"""Places along each side of the wall, between its ends."""

INNER = 0.9
"""Part of the wall's length that they take: beside an end the cap may be seen."""

STEPS = np.linspace(-1.0, 1.5, 81)
"""Where the surface may end, in radii beyond the outline: each 32nd of a radius."""

LASTING = 2.0
"""Pixels over which there must be background: one reading may be an outlier."""

MIN_PLACES = 4
"""Fewest places of a side that show the outline."""


class _Wall(NamedTuple):
    """The wall of a cylinder beside the two planes through the camera that touch it.

    Attributes:
        radius: In meters.
        normal: Of both planes, outward, in the camera frame.
        limb: Points where they touch it, in the camera frame.
    """

    radius: float
    normal: Float[np.ndarray, "2 3"]
    limb: Float[np.ndarray, "2 s 3"]


def compared_with_outline(fit: Fit, seen: Sequence[Seen], is_outline: bool) -> Fit:
    """The fit with its outline gap; a failed one where that contradicts the depth.

    Args:
        fit: Concrete and single.
        seen: The object in each of its images.
        is_outline: Whether the edge of the regions is the silhouette.
    """
    # Not `fit.cylinder`: a call of a method of a fit takes 0.1 ms.
    body = fit.shape
    if not (isinstance(body, Cylinder) and fit.is_shape):
        return fit
    found = [gap for one in seen for gap in _gaps(fit, body, one, is_outline)]
    if not found:
        return fit
    gap = max(found, key=lambda one: abs(one.deviations))
    fit = fit.noting(outline_gap=gap)
    if abs(gap.radii) <= LARGE_GAP or not bool(fit.success):
        return fit
    radius = 1e3 * float(body.radius)
    told = (
        f"the image shows the wall's outline {abs(gap.pixels):.1f} pixels "
        f"{'beyond' if gap.pixels > 0 else 'within'} the fit's, which is "
        f"{abs(gap.radii) * radius:.1f} mm at a radius of {radius:.1f} mm"
    )
    if abs(gap.deviations) > MOST_DEVIATIONS:
        return fit.contradicted(
            f"{told} and {abs(gap.deviations):.0f} deviations: the depth is skewed, or "
            "the region is not of one cylinder."
        )
    if abs(gap.pixels) > NOTED * np.hypot(EDGE, gap.fit_pixels):
        warnings.warn(
            f"{told}: unless edges in the image are off by as much, the radius is "
            "wrong; fit.outline_gap tells more",
            # The line that called `fit_cylinder`.
            stacklevel=5,
        )
    return fit


def _gaps(fit: Fit, body: Cylinder, seen: Seen, is_outline: bool) -> list[OutlineGap]:
    """Gaps of those sides of the wall whose outline an image shows."""
    camera = seen.camera
    if not isinstance(camera, PinholeCamera):
        return []
    rotation, shift = _camera_from_world(camera)
    wall = _wall(body, rotation, shift)
    if wall is None:
        return []
    points = wall.normal[:, None, None] * (wall.radius * STEPS)[:, None]
    points = points + wall.limb[:, :, None]
    if points[..., 2].min() <= 0:
        return []
    places = _projected(points, camera)
    behind = wall.limb[..., 2] + BEHIND * wall.radius + 3 * float(fit.rms)
    surface, background, shown = _bounds(
        seen, behind, JUMP * wall.radius, places, is_outline
    )
    sides = np.flatnonzero(np.count_nonzero(shown, axis=1) >= MIN_PLACES)
    if not len(sides):
        return []
    # A sensor moves edges by up to so many pixels: uniformly.
    edge = float(np.hypot(EDGE, float(seen.noise.bias.outline) / np.sqrt(3)))
    covariance, found = _covariance(fit, body), []
    gaps = np.maximum(surface, 0) + np.minimum(background, 0)
    for k in sides:
        # Of a few numbers NumPy's median takes 0.05 ms.
        radii = statistics.median(gaps[k, shown[k]].tolist())
        ends = places[k, NUM_PLACES // 2, [0, -1]]
        pixels = np.linalg.norm(ends[1] - ends[0]) / np.ptp(STEPS)
        # The plane that touches the wall moves as the center does across it, and as
        # the radius.
        moves = np.append(rotation.T @ wall.normal[k], 1.0)
        variance = max(float(moves @ covariance @ moves), 0.0)
        of_fit = float(np.sqrt(variance) / wall.radius * pixels)
        gap = float(radii * pixels)
        deviations = gap / float(np.hypot(of_fit, edge))
        found.append(OutlineGap(gap, radii, deviations, of_fit, edge))
    return found


def _wall(
    body: Cylinder,
    rotation: Float[np.ndarray, "3 3"],
    shift: Float[np.ndarray, "3"],
) -> _Wall | None:
    """The wall as a camera sees it; None from within."""
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
    along = np.linspace(-INNER / 2, INNER / 2, NUM_PLACES) * float(body.height)
    limb = center + radius * normal[:, None] + along[:, None] * axis
    return _Wall(radius, normal, limb)


def _bounds(
    seen: Seen,
    behind: Float[np.ndarray, "2 s"],
    jump: float,
    places: Float[np.ndarray, "2 s t 2"],
    is_outline: bool,
) -> tuple[Float[np.ndarray, "2 s"], Float[np.ndarray, "2 s"], Bool[np.ndarray, "2 s"]]:
    """Where the surface is seen last and the background first, in radii.

    Args:
        seen: The object in the image.
        behind: Depth at each place of both sides beyond which the background is.
        jump: From the last of the surface to the first of the background, at least.
        places: Columns and rows of the image from there outward, by `STEPS`.
        is_outline: Whether the region's edge is the silhouette.

    Returns:
        Both of each place, and whether it shows the outline.
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
        ends = np.take_along_axis(depth, np.stack([last, first], axis=-1), axis=-1)
        shown &= ends[..., 1] - ends[..., 0] > jump
        until = np.where(follows, first, STEPS.size)
        between = (step > last[..., None]) & (step < until[..., None])
        # What lies in front of the surface hides where that ends. Of a side that is
        # mostly hidden, outliers before the occluder would be left.
        in_front = between & (depth > 0) & (depth < ends[..., :1] - jump)
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


def _covariance(fit: Fit, body: Cylinder) -> Float[np.ndarray, "4 4"]:
    """Of the center's motions across the axis, in the world frame, and the radius."""
    names = ("center_first", "center_second", "radius")
    places = [fit.coordinates.index(name) for name in names]
    covariance = np.asarray(fit.covariance, np.float64)[np.ix_(places, places)]
    into = np.zeros((3, 4))
    into[:2, :3], into[2, 3] = _basis(body.axis), 1.0
    return into.T @ covariance @ into


_basis = jax.jit(tangent_basis)


def _camera_from_world(
    camera: PinholeCamera,
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Rotation and translation of a camera."""
    pose = camera.camera_from_world
    if pose is None:
        return np.eye(3), np.zeros(3)
    return (
        np.asarray(pose.rotation, np.float64),
        np.asarray(pose.translation, np.float64),
    )


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
