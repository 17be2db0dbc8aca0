"""What the outline's tests compare with: polygons of many vertices, in float64.

The silhouette is the convex hull of the projected rims, cut off in front of the camera,
and its area in each pixel comes from clipping that hull by the pixel's sides. Nothing
is shared with the package.
"""

import cv2
import numpy as np
from scipy.spatial import ConvexHull

VERTICES = 10_000
NEAR = 1e-3
PARAMETERS = (
    "axis 1",
    "axis 2",
    "center x",
    "center y",
    "center z",
    "radius",
    "height",
)


def unit(axis):
    axis = np.asarray(axis, float)
    return axis / np.linalg.norm(axis)


def tangents(axis):
    """Two directions in which a unit vector can move."""
    return np.linalg.svd(unit(axis)[None])[2][1:]


def moved(shape, parameter: int, step: float):
    """A shape (center, axis, radius, height) after a step in one of the parameters."""
    center, axis, radius, height = shape
    center, axis = np.array(center, float), unit(axis)
    if parameter < 2:
        axis = axis + step * tangents(axis)[parameter]
    elif parameter < 5:
        center[parameter - 2] += step
    radius, height = radius + step * (parameter == 5), height + step * (parameter == 6)
    return center, axis, radius, height


def silhouette(shape, camera=None, count=VERTICES):
    """Vertices of the convex silhouette: at z = 1, or in pixels without a lens."""
    center, axis, radius, height = shape
    axis = unit(axis)
    across = np.linalg.svd(axis[None])[2][1:]
    angle = np.linspace(0, 2 * np.pi, count // 2, endpoint=False)[:, None]
    ring = radius * (np.cos(angle) * across[0] + np.sin(angle) * across[1])
    low, high = (np.asarray(center) + s * height / 2 * axis + ring for s in (-1, 1))
    points = [np.concatenate([low, high])]
    points[0] = points[0][points[0][:, 2] >= NEAR]
    rims = [(rim, np.roll(rim, -1, 0)) for rim in (low, high)]
    for start, end in [(low, high), *rims]:
        crosses = (start[:, 2] < NEAR) != (end[:, 2] < NEAR)
        start, end = start[crosses], end[crosses]
        t = (NEAR - start[:, 2:]) / (end[:, 2:] - start[:, 2:])
        points.append(start + t * (end - start))
    points = np.concatenate(points)
    if len(points) == 0:
        return np.zeros((0, 2))
    image = points[:, :2] / points[:, 2:]
    if camera is not None:
        image = image * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    return image[ConvexHull(image).vertices]


def through_lens(polygon, camera, limit, spacing=1e-3):
    """Image of a polygon of the plane z = 1, its edges filled with points.

    Args:
        polygon: Vertices, cut off at `limit` from the axis in x and in y.
        camera: With a lens.
        limit: Beyond what the image shows, within what the lens model is good for.
        spacing: Between points, in the plane z = 1.
    """
    for side in ((0, limit, 1), (0, -limit, -1), (1, limit, 1), (1, -limit, -1)):
        polygon = clip(polygon, *side)
    points = []
    for start, end in zip(polygon, np.roll(polygon, -1, 0), strict=True):
        parts = max(1, int(np.linalg.norm(end - start) / spacing))
        points.append(start + np.arange(parts)[:, None] / parts * (end - start))
    points = np.concatenate(points)
    rays = np.concatenate([points, np.ones((len(points), 1))], axis=1)[None]
    still, lens = np.zeros(3), np.asarray(camera.distortion, float)
    project = cv2.fisheye.projectPoints if camera.fisheye else cv2.projectPoints
    return project(rays, still, still, camera.matrix(), lens)[0].reshape(-1, 2)


def clip(polygon, coordinate: int, bound: float, sign: int):
    """Part of a polygon where sign * (x - bound) <= 0 (Sutherland and Hodgman)."""
    if len(polygon) == 0:
        return polygon
    off = sign * (polygon[:, coordinate] - bound)
    following = np.concatenate([polygon[1:], polygon[:1]])
    off_following = np.concatenate([off[1:], off[:1]])
    keep, crosses = off <= 0, (off <= 0) != (off_following <= 0)
    t = np.where(crosses, off / np.where(crosses, off - off_following, 1), 0)[:, None]
    both = np.empty((len(polygon), 2, 2))
    both[:, 0], both[:, 1] = polygon, polygon + t * (following - polygon)
    return both[np.column_stack([keep, crosses])]


def area(polygon):
    if len(polygon) < 3:
        return 0.0
    x, y = (polygon - polygon[0]).T
    return 0.5 * abs(x[:-1] @ y[1:] - y[:-1] @ x[1:])


def in_frame(polygon, camera):
    for side in (
        (0, camera.width - 0.5, 1), (0, -0.5, -1),
        (1, camera.height - 0.5, 1), (1, -0.5, -1),
    ):  # fmt: skip
        polygon = clip(polygon, *side)
    return polygon


def coverage(polygon, camera):
    """Area of a polygon in each pixel."""
    covered = np.zeros((camera.height, camera.width))
    below = clip(polygon, 1, -0.5, -1)
    for i in range(camera.height):
        row, below = clip(below, 1, i + 0.5, 1), clip(below, 1, i + 0.5, -1)
        if len(row) < 3:
            continue
        first = max(0, int(np.floor(row[:, 0].min() + 0.5)))
        last = min(camera.width - 1, int(np.ceil(row[:, 0].max() - 0.5)))
        rest = clip(row, 0, first - 0.5, -1)
        for j in range(first, last + 1):
            covered[i, j] = area(clip(rest, 0, j + 0.5, 1))
            rest = clip(rest, 0, j + 0.5, -1)
    return covered


def points_along(polygon, camera, count=100):
    """Points of the outline in the image, equally spaced, and its length there."""
    seen = in_frame(polygon, camera)
    step = np.roll(seen, -1, 0) - seen
    length = np.linalg.norm(step, axis=1)
    walked = np.cumsum(length)
    place = (np.arange(count) + 0.5) / count * walked[-1]
    edge = np.searchsorted(walked, place)
    part = 1 - (walked[edge] - place) / length[edge]
    points = seen[edge] + part[:, None] * step[edge]
    half = np.array([camera.width, camera.height]) / 2
    inner = (np.abs(points - half + 0.5) < half - 1e-9).all(1)
    return points[inner], walked[-1] * inner.mean()


def signed_distance(polygon, points):
    """Distance from the border of a polygon, negative inside."""
    step = np.roll(polygon, -1, 0) - polygon
    square = (step**2).sum(1)
    polygon, step, square = polygon[square > 0], step[square > 0], square[square > 0]
    x, y = (points[:, None, i] - polygon[None, :, i] for i in (0, 1))
    foot = np.clip((x * step[None, :, 0] + y * step[None, :, 1]) / square[None], 0, 1)
    off_x, off_y = x - foot * step[None, :, 0], y - foot * step[None, :, 1]
    distance = np.sqrt((off_x**2 + off_y**2).min(1))
    # An odd number of edges passes above a point inside.
    above = (x >= 0) != (np.roll(x, -1, 1) >= 0)
    above &= (y - x * (step[:, 1] / np.where(step[:, 0] == 0, 1, step[:, 0]))[None]) > 0
    return np.where(above.sum(1) % 2 == 1, -distance, distance)


def derivatives(shape, camera, step=1e-5):
    """Of the area in the image, and the outline's length times its rms speed there.

    Returns:
        Two arrays with an entry for each of `PARAMETERS`.
    """
    points, length = points_along(silhouette(shape, camera, 500), camera)
    slopes, scales = [], []
    for parameter in range(len(PARAMETERS)):
        both = [moved(shape, parameter, sign * step) for sign in (1, -1)]
        areas = [area(in_frame(silhouette(s, camera, 2500), camera)) for s in both]
        near = [signed_distance(silhouette(s, camera, 500), points) for s in both]
        slopes.append((areas[0] - areas[1]) / (2 * step))
        speed = (near[1] - near[0]) / (2 * step)
        scales.append(length * np.sqrt((speed**2).mean()))
    return np.array(slopes), np.array(scales)
