"""The command `impostor-jax track`."""

__all__ = ["TrackCommand"]

import contextlib
import dataclasses
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import tyro

from impostor_jax.cli.ending import stream_beside
from impostor_jax.cli.given import chosen_noise, hints_on_stderr, images_of, priors_of
from impostor_jax.cli.inputs import check_images, check_noise, check_video
from impostor_jax.io.atomic import check_output_file
from impostor_jax.plain_arguments import plain_number, whole_number

if TYPE_CHECKING:
    from impostor_jax.camera.pinhole import PinholeCamera
    from impostor_jax.viewer.video import TrackVideo


class Image(NamedTuple):
    """An image of the video.

    Attributes:
        name: Of its file, without its ending.
        seconds: When it was taken; None if nothing says it.
        read: Reads its depth, in meters, and the pose of its camera; None if nothing
            says that.
    """

    name: str
    seconds: float | None
    read: Callable[[], tuple[Any, Any]]


@dataclasses.dataclass(frozen=True)
class TrackCommand:
    """Follow every cylinder through a video of depth images.

    Writes a table with a row for each track in each image: identity, status, estimate,
    velocity and standard deviations. With --page, a page for a browser, too, with a
    slider over the images. A folder is a sequence of TUM RGB-D, BOP, ScanNet
    or Redwood, with its cameras and poses, or, with --camera, one of depth images in
    the order of their names. What cannot be read is an image that was dropped, and is
    told. The exit code is 0 if a cylinder was followed, 1 if none was found or images
    were dropped, and 2 if the input is bad.
    """

    folder: tyro.conf.Positional[Path]
    """Folder of the video."""
    camera: Path | None = None
    """Camera file (JSON) of plain depth images: fx, fy, cx, cy, width, height,
    depth_scale_m, distortion."""
    sigma: float | None = None
    """Standard deviation of a depth reading, in meters; measured if neither this nor a
    sensor is given."""
    sensor: str | None = None
    """Model of the sensor, as in `fit`."""
    frame_rate: float = 30.0
    """Images in a second, where no file says when one was taken."""
    search_every: int = 15
    """Images from one search to the next, as in `Tracker`, like the others."""
    patience: float = 2.0
    """Seconds for which what is hidden, or out of the image, is kept."""
    absence: float = 0.3
    """Seconds for which what is gone is kept."""
    radius_range: tuple[float, float] | None = None
    """Smallest and largest radius, in meters."""
    prior_radius: tuple[float, float] | None = None
    """Expected radius of every cylinder and its standard deviation, in meters."""
    prior_height: tuple[float, float] | None = None
    """Expected height and its standard deviation, in meters."""
    output: Path = Path("tracks.csv")
    """Table to write: .csv, or .parquet (extra: table)."""
    video: Path | None = None
    """Video to write, too: .mp4 or .avi, of the depth images with the outlines and
    identities of the tracks, those that are lost in gray."""
    page: Path | None = None
    """HTML file on which the tracks are looked at image by image, in a browser with
    WebGL2: in space, their numbers, and small depth images with the outlines."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        from tqdm import tqdm

        from impostor_jax.io.tables import check_table, columns_of, write_rows

        check_noise(self.sigma, self.sensor)
        plain_number("frame_rate", self.frame_rate, positive=True, unit="1/seconds")
        whole_number("search_every", self.search_every, 1)
        check_table(self.output, "output")
        check_video(self.video)
        if self.page is not None:
            check_output_file(self.page, "page")
        if not self.folder.is_dir():
            raise ValueError(f"folder {str(self.folder)!r} does not exist")
        camera, count, images = self._images()
        # This starts JAX.
        from impostor_jax.camera.base import posed
        from impostor_jax.page.track_page import TrackPage
        from impostor_jax.track.tracker import Tracker

        asked: dict[str, Any] = {}
        if self.radius_range is not None:
            asked["radius_range"] = self.radius_range
        tracker = Tracker(
            camera,
            chosen_noise(self.sigma, self.sensor, lambda: camera),
            frame_rate=self.frame_rate,
            search_every=self.search_every,
            patience=self.patience,
            absence=self.absence,
            prior=priors_of(self.prior_radius, self.prior_height),
            **asked,
        )
        rows, identities, dropped = [], set(), 0
        page = None if self.page is None else TrackPage()
        shown = tqdm(images, total=count, unit="image", disable=None, file=sys.stderr)
        with hints_on_stderr(), self._video(camera) as video:
            for number, image in enumerate(shown):
                try:
                    depth, pose = image.read()
                except (ValueError, OSError) as error:
                    shown.write(f"{image.name}: {error}", file=sys.stderr)
                    dropped += 1
                    continue
                seconds = image.seconds
                if seconds is None:
                    # Of those that were dropped, too.
                    seconds = number / self.frame_rate
                tracks = tracker.step(depth, seconds, pose)
                identities |= {track.identity for track in tracks}
                place = {"image": number, "name": image.name}
                rows += [place | columns_of(track.to_dict()) for track in tracks]
                seen_by = camera if pose is None else posed(camera, pose)
                if video is not None:
                    video.add(depth, seen_by, tracks)
                if page is not None:
                    assert tracker.time is not None
                    page.add(depth, seen_by, tracks, tracker.time)
        write_rows(lambda: rows, self.output)
        tell = partial(print, file=stream_beside(self.page))
        tell(f"{self.output}: {len(identities)} cylinders in {count - dropped} images")
        if self.page is not None and page is not None:
            page.save(self.page)
        return 0 if identities and not dropped else 1

    @contextlib.contextmanager
    def _video(self, camera: "PinholeCamera") -> "Iterator[TrackVideo | None]":
        """The video, if one is asked for; nothing is left of one that was cut short."""
        from impostor_jax.viewer.video import TrackVideo

        if self.video is None:
            yield None
            return
        size = camera.height, camera.width
        video = TrackVideo(self.video, size, self.frame_rate)
        try:
            yield video
        except BaseException:
            video.drop()
            raise
        video.close()

    def _images(self) -> "tuple[PinholeCamera, int, Iterator[Image]]":
        """The camera, how many images there are, and each as it is read."""
        if self.camera is not None:
            return _plain(self.camera, images_of((self.folder,)))
        from impostor_jax.io.depth_folder import read_depth_folder
        from impostor_jax.io.depth_layouts import kind_of

        frames = read_depth_folder(self.folder)
        # TUM's files are named by the second.
        is_timed = kind_of(self.folder) == "tum"

        def read(index: int) -> tuple[Any, Any]:
            frame = frames[index]
            return frame.depth, frame.camera.camera_from_world

        images = (
            Image(shot.name, float(shot.name) if is_timed else None, partial(read, k))
            for k, shot in enumerate(frames.shots)
        )
        return frames[0].camera, len(frames), images


def _plain(
    file: Path, paths: Sequence[Path]
) -> "tuple[PinholeCamera, int, Iterator[Image]]":
    """The same of plain depth images, which a camera file is of."""
    check_images(file, paths[:1], {})
    from impostor_jax.io.camera_file import pinhole_of, read_camera
    from impostor_jax.io.depth_image import read_depth

    camera, depth_scale_m = read_camera(file)
    camera = pinhole_of(camera, "the camera of a video")
    size = camera.height, camera.width

    def read(path: Path) -> tuple[Any, Any]:
        return read_depth(path, depth_scale_m, size), None

    images = (Image(path.stem, None, partial(read, path)) for path in paths)
    return camera, len(paths), images
