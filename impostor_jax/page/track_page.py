"""A page on which a person looks at the tracks of a video, image by image.

It is one file, as the page of a fit, with a slider over the images. A depth image is a
small gray picture, whose levels the page takes apart again: it colors them, and shows
the readings in space.
"""

__all__ = ["TrackPage"]

import base64
import dataclasses
import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import matplotlib
import numpy as np
from jaxtyping import Float, UInt8

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.glsl.html import html_page, packed
from impostor_jax.glsl.orbit_page import upright
from impostor_jax.glsl.program import mark_sources
from impostor_jax.io.atomic import write_text
from impostor_jax.opencv import cv2
from impostor_jax.page.fit_page import DIALECT, drawn_message
from impostor_jax.page.frame import PageFrame, frame_around, pose_of
from impostor_jax.page.picture import COLORS, MISSING, png_url, svg_path
from impostor_jax.page.told import Number, track_numbers
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.track.track import Track, TrackStatus
from impostor_jax.viewer.figure import fitted_outline
from impostor_jax.viewer.video import LOST, color_of

PICTURE_SIZE = (120, 160)
"""Rows and columns that a picture has at most."""

LEVELS = 254
"""Of inverse depth in a picture, from 1; 0 is no reading."""

ENDS = (0.5, 99.5)
"""Percentiles of the depths of an image from which on they share a level."""

MOST_OF_TRACKS, MOST_OF_PICTURES = 2_000_000, 2_300_000
"""Bytes of what a page tells of the tracks, and of its pictures: 5 MB with all else."""

STRAIGHT = 1 / 1500
"""Part of an image's width by which an outline may be off that is told with fewer
corners: a quarter of a pixel of a page."""

SPARSE = 0.5
"""Width of a reading, of a pixel's of its picture: what is behind shows through."""

DIGITS = 7
"""Of the numbers of a shape."""


@dataclasses.dataclass(frozen=True)
class Image:
    """An image of the video, with what the tracker said of it.

    Attributes:
        told: What the script is told, but for the frame of the page.
        size: Bytes of that.
        picture: URL of its picture.
        camera: That took it, with its pose.
        shapes: Center, axis, radius and height of each cylinder, in the world, in
            meters.
        is_seen: Which of them the image shows.
    """

    told: dict[str, Any]
    size: int
    picture: str
    camera: PinholeCamera
    shapes: Float[np.ndarray, "n 8"]
    is_seen: list[bool]


class TrackPage:
    """A page that grows by an image."""

    def __init__(self):
        self._images: list[Image] = []
        self._identities: dict[int, int] = {}
        self._rows: list[Number] = []

    def add(
        self, depth: Any, camera: PinholeCamera, tracks: Sequence[Track], seconds: float
    ) -> None:
        """Add an image.

        Args:
            depth: (H, W), in meters; 0 or not finite where there is no reading.
            camera: That took it, with its pose; all are of one size.
            tracks: Of the tracker after it.
            seconds: When it was taken.
        """
        picture, ends = _picture(np.asarray(depth, float), camera)
        told: dict[str, Any] = {"seconds": round(seconds, 6), "ends": ends}
        told["tracks"] = [self._track_message(one, camera) for one in tracks]
        shapes = [one.cylinder for one in tracks]
        rows = [
            np.concatenate([s.center, s.axis, [s.radius, s.height]]) for s in shapes
        ]
        self._images.append(
            Image(
                told=told,
                size=len(repr(told)) + 12 * DIGITS * (1 + len(tracks)),
                picture=picture,
                camera=camera,
                shapes=np.array(rows, float).reshape(-1, 8),
                is_seen=[one.status is not TrackStatus.LOST for one in tracks],
            )
        )

    def _track_message(self, track: Track, camera: PinholeCamera) -> dict[str, Any]:
        """What the script is told of a track in an image, but for its shape."""
        number = self._identities.setdefault(track.identity, len(self._identities))
        numbers = track_numbers(track)
        self._rows = numbers
        outline = fitted_outline(track.cylinder, camera)
        return {
            "number": number,
            "status": str(track.status),
            "reason": track.reason,
            "outline": "" if outline is None else _short_path(outline, camera),
            "values": [text for one in numbers for text in (one.value, one.std)],
        }

    @property
    def html(self) -> str:
        """The whole page.

        Raises:
            ValueError: No image was added.
        """
        if not self._images:
            raise ValueError("a page must have an image at least, got none")
        sizes = [image.size for image in self._images]
        every = _step(sizes, MOST_OF_TRACKS)
        images = self._images[::every]
        of_pictures = [len(image.picture) for image in images]
        every_picture = _step(of_pictures, MOST_OF_PICTURES)
        frame = self._frame()
        first = self._images[0].camera
        rows, cols, step = _grid(first)
        message = {
            "images": [
                {
                    **image.told,
                    "number": every * k,
                    "picture": None if k % every_picture else image.picture,
                    "pose": _pose_message(frame, image.camera),
                    "shapes": _shapes_message(frame, image.shapes),
                }
                for k, image in enumerate(images)
            ],
            "count": len(self._images),
            "every": every,
            "everyPicture": every_picture,
            "identities": list(self._identities),
            "colors": [_hex(color_of(identity)) for identity in self._identities],
            "lost": _hex(LOST),
            "rows": [[one.name, one.unit] for one in self._rows],
            "cylinder": drawn_message(Cylinder((0, 0, 0), (0, 0, 1), 1, 1), frame),
            "size": [step * len(cols), step * len(rows)],
            "grid": [len(cols), len(rows)],
            "rays": packed(_rays(first, rows, cols)),
            "depthColors": _depth_colors(),
            "footprint": [0.0, SPARSE * step / min(float(first.fx), float(first.fy))],
            "limit": frame.radius / 200,
            "up": upright(first),
            "radius": frame.radius,
            "reach": self._reach(frame),
            "readings": mark_sources("reading", DIALECT),
            "wires": mark_sources("wire", DIALECT),
        }
        return html_page("page/track_page.html", message)

    def save(self, path: Path) -> None:
        """Write the page to a file, which a browser opens."""
        write_text(path, self.html)

    def _frame(self) -> PageFrame:
        """In which all that was seen is central, or else what was read at first."""
        camera = self._images[0].camera
        seen = [
            shape
            for image in self._images
            for shape in itertools.compress(image.shapes, image.is_seen)
        ]
        if not seen:
            (near, far), pose = self._images[0].told["ends"], pose_of(camera)
            middle = pose[1] + [0, 0, (near + far) / 2]
            return PageFrame(pose[0], pose[1] - middle, far / 2)
        shapes = np.array(seen)
        reach = np.hypot(shapes[:, 6], shapes[:, 7] / 2)
        return frame_around(camera, shapes[:, :3], reach)

    def _reach(self, frame: PageFrame) -> float:
        """How far anything is from the origin of the page, in meters."""
        away = [2 * frame.radius]
        for image in self._images:
            place = frame.from_camera(np.zeros(3), image.camera)
            away.append(2 * image.told["ends"][1] + float(np.linalg.norm(place)))
        return max(away)


def _step(sizes: Sequence[int], most: int) -> int:
    """The smallest n of which every n-th has so many bytes together."""
    step = 1
    while sum(sizes[::step]) > most and step < len(sizes):
        step += 1
    return step


def _grid(camera: PinholeCamera) -> tuple[np.ndarray, np.ndarray, int]:
    """Rows and columns of the pixels that a picture has, and their distance."""
    most_rows, most_cols = PICTURE_SIZE
    step = max(
        math.ceil(camera.height / most_rows), math.ceil(camera.width / most_cols)
    )
    start = min(step // 2, camera.height - 1, camera.width - 1)
    return (
        np.arange(start, camera.height, step),
        np.arange(start, camera.width, step),
        step,
    )


def _rays(
    camera: PinholeCamera, rows: np.ndarray, cols: np.ndarray
) -> Float[np.ndarray, "n 3"]:
    """How the rays of a picture go on with each meter of depth, from the camera."""
    row, col = np.meshgrid(rows, cols, indexing="ij")
    ray = camera.rays(
        jnp.asarray(row.ravel()), jnp.asarray(col.ravel()), jnp.result_type(float)
    )
    return np.nan_to_num(np.asarray(ray.direction.stack(), float))


def _picture(
    depth: Float[np.ndarray, "h w"], camera: PinholeCamera
) -> tuple[str, list[float]]:
    """A depth image as the URL of a gray PNG, and the depths of its ends, in meters.

    Levels are even in inverse depth, from the nearest, `LEVELS`, to the farthest, 1.
    """
    rows, cols, _ = _grid(camera)
    small = depth[np.ix_(rows, cols)]
    is_read = np.isfinite(small) & (small > 0)
    row, col = np.meshgrid(rows, cols, indexing="ij")
    is_seen = camera.sees(jnp.asarray(row), jnp.asarray(col))
    if is_seen is not None:
        is_read &= np.asarray(is_seen)
    near, far = np.percentile(small[is_read], ENDS) if is_read.any() else (0.5, 1.0)
    near, far = (float(f"{x:.{DIGITS}g}") for x in (near, max(far, near * 1.001)))
    inverse = 1 / np.where(is_read, small, far)
    part = np.clip((inverse - 1 / far) / (1 / near - 1 / far), 0, 1)
    levels = np.where(is_read, 1 + np.round((LEVELS - 1) * part), 0).astype(np.uint8)
    return png_url(levels, cv2.IMWRITE_PNG_COMPRESSION, 9), [near, far]


def _short_path(outline: Float[np.ndarray, "n 2"], camera: PinholeCamera) -> str:
    """The path of an SVG, in image coordinates, with as few corners as will do."""
    away = 2 * max(camera.width, camera.height)
    curve = np.clip(outline, -away, away).astype(np.float32)
    corners = cv2.approxPolyDP(curve, STRAIGHT * camera.width, closed=True)
    return svg_path(corners[:, 0])


def _pose_message(frame: PageFrame, camera: PinholeCamera) -> list[float]:
    """Axes of a camera on the page, one after the other, and its place."""
    place = frame.from_camera(np.zeros(3), camera)
    axes = frame.from_camera(np.eye(3), camera) - place
    return _rounded([*axes.ravel(), *place])


def _shapes_message(
    frame: PageFrame, shapes: Float[np.ndarray, "n 8"]
) -> list[list[float]]:
    """What the shaders are told of each cylinder."""
    moved = np.hstack([frame.apply(shapes[:, :3]), frame.turned(shapes[:, 3:6])])
    return [_rounded(row) for row in np.hstack([moved, shapes[:, 6:]])]


def _rounded(values: Sequence[float] | np.ndarray) -> list[float]:
    return [float(f"{x:.{DIGITS}g}") for x in values]


def _depth_colors() -> str:
    """Red, green and blue of the levels of a picture, as base64: near ones are dark."""
    place = 1 - np.arange(LEVELS) / (LEVELS - 1)
    colors: UInt8[np.ndarray, "n 3"] = matplotlib.colormaps[COLORS](place, bytes=True)
    missing = np.full((1, 3), MISSING, np.uint8)
    table = np.vstack([missing, colors[:, :3]])
    return base64.b64encode(np.ascontiguousarray(table).tobytes()).decode()


def _hex(color: tuple[int, int, int]) -> str:
    """As in a style, of blue, green and red."""
    return "#" + "".join(f"{x:02x}" for x in reversed(color))
