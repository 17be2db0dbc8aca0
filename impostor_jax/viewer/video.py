"""Videos of tracks: depth images with the outlines and numbers of what is followed."""

__all__ = ["LOST", "TrackVideo", "color_of"]

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.opencv import cv2
from impostor_jax.track.track import Track, TrackStatus
from impostor_jax.viewer.figure import fitted_outline

CODECS = {".mp4": "mp4v", ".avi": "MJPG"}
"""By the end of a video's name."""

SHARP = 4
"""Fractional bits of the corners of outlines that OpenCV draws."""

LOST = (160, 160, 160)
"""Color of what is not seen, blue first as in OpenCV, like the next."""

COLORS = (
    (75, 25, 230), (75, 180, 60), (25, 225, 255), (200, 130, 0), (48, 130, 245),
    (180, 30, 145), (240, 240, 70), (230, 50, 240), (60, 245, 210), (212, 190, 250),
)  # fmt: skip
"""Of tracks, in turn by their identities: ten that are told apart."""


def color_of(identity: int) -> tuple[int, int, int]:
    """Color of a track that is seen, blue first."""
    return COLORS[(identity - 1) % len(COLORS)]


class TrackVideo:
    """A video that grows by an image; it has its name once it is closed.

    Depth is colored from the nearest to the farthest reading of the first image.

    Args:
        path: Ends with `.mp4` or `.avi`.
        size: Rows and columns of the images.
        frame_rate: Images in a second.
    """

    def __init__(self, path: Path, size: tuple[int, int], frame_rate: float):
        height, width = size
        self._path = path
        self._folder = tempfile.TemporaryDirectory(
            prefix=f".{path.name}.", dir=path.parent
        )
        self._partial = Path(self._folder.name) / path.name
        code = cv2.VideoWriter.fourcc(*CODECS[path.suffix.lower()])
        self._writer = cv2.VideoWriter(
            str(self._partial), code, frame_rate, (width, height)
        )
        if not self._writer.isOpened():
            self._folder.cleanup()
            raise ValueError(f"OpenCV cannot write the video {str(path)!r}")
        self._limits: tuple[float, float] | None = None

    def add(self, depth: Any, camera: PinholeCamera, tracks: Sequence[Track]) -> None:
        """Add an image.

        Args:
            depth: (H, W), in meters; 0 or not finite where there is no reading.
            camera: That took it, with its pose.
            tracks: Of the tracker after it.
        """
        picture = self._colored(np.asarray(depth, float))
        for track in tracks:
            is_lost = track.status is TrackStatus.LOST
            color = LOST if is_lost else color_of(track.identity)
            outline = fitted_outline(track.cylinder, camera)
            if outline is None:
                continue
            corners = np.clip(outline, -(2**14), 2**14) * 2**SHARP
            cv2.polylines(
                picture,
                [np.round(corners).astype(np.int32)],
                isClosed=True,
                color=color,
                thickness=1 if is_lost else 2,
                lineType=cv2.LINE_AA,
                shift=SHARP,
            )
            left, top = outline.min(axis=0)
            place = max(int(left), 0), max(int(top) - 4, 12)
            cv2.putText(
                picture,
                str(track.identity),
                place,
                cv2.FONT_HERSHEY_SIMPLEX,
                0.5,
                color,
                1,
                cv2.LINE_AA,
            )
        self._writer.write(picture)

    def _colored(self, depth: np.ndarray) -> UInt8[np.ndarray, "h w 3"]:
        is_read = np.isfinite(depth) & (depth > 0)
        if self._limits is None and is_read.any():
            near, far = np.percentile(depth[is_read], (1, 99))
            self._limits = float(near), max(float(far), float(near) * 1.001)
        near, far = self._limits or (0.0, 1.0)
        shown = np.clip((np.where(is_read, depth, near) - near) / (far - near), 0, 1)
        levels = (255 * shown).astype(np.uint8)
        picture = cv2.applyColorMap(levels, cv2.COLORMAP_VIRIDIS)
        picture[~is_read] = 0
        return picture

    def close(self) -> None:
        """End the video, and give it its name."""
        self._writer.release()
        self._partial.replace(self._path)
        self._folder.cleanup()

    def drop(self) -> None:
        """Leave nothing of it."""
        self._writer.release()
        self._folder.cleanup()
