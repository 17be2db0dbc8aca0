"""Checks of a command's files before JAX starts, which takes seconds.

What is missing, no image or of the wrong size is refused at once, with the error that
reading it later would give. Of several images the headers are looked at, of the first
one the pixels, too.
"""

__all__ = [
    "check_cloud",
    "check_images",
    "check_noise",
    "check_page",
    "check_single_image",
    "check_video",
]

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from impostor_jax.io.atomic import check_output_file, check_output_folder
from impostor_jax.io.camera_formats import read_camera_record, size_of_record
from impostor_jax.io.input_file import require_file
from impostor_jax.io.json_file import read_json_object
from impostor_jax.io.point_cloud import SUFFIXES
from impostor_jax.plain_arguments import plain_number

VIDEOS = (".mp4", ".avi")
"""Endings of videos."""


def check_images(
    camera: Path, depths: Sequence[Path], beside: Mapping[str, Sequence[Path]]
) -> None:
    """Raise a `ValueError` unless images are of a camera.

    Args:
        camera: Camera file.
        depths: Depth images.
        beside: Masks and label images of them, by what errors call them.
    """
    record = read_camera_record(camera)
    # OpenCV is imported after that file is known to be good.
    from impostor_jax.io.depth_image import check_depth_file, read_depth
    from impostor_jax.io.image_file import check_image, read_integers

    width, height = size_of_record(record)
    size = height, width
    for path in depths[:1]:
        read_depth(path, record.get("depth_scale_m"), size)
    for path in depths[1:]:
        check_depth_file(path, size)
    for what, paths in beside.items():
        for number, path in enumerate(paths):
            check = check_image if number else read_integers
            check(path, f"{what} {str(path)!r}", size)


def check_cloud(path: Path, verb: str, of_images: Mapping[str, Any]) -> None:
    """Raise a `ValueError` where a cloud is asked what images have, or is none.

    Args:
        path: Its file.
        verb: What is done with it: fit or search.
        of_images: Values of the flags that images alone have.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(
            f"--camera must be given to {verb} the depth image {str(path)!r}; clouds "
            f"end in one of {', '.join(SUFFIXES)}"
        )
    require_file(path, f"point file {str(path)!r}")
    for flag, value in of_images.items():
        if value:
            raise ValueError(f"{flag} must be given with depth images alone")


def check_noise(
    sigma: float | None, sensor: str | None, *, is_of_edge: bool = False
) -> None:
    """Raise a `ValueError` where `--sigma` or the file of `--sensor` is bad.

    That of an edge is in pixels, and may be 0.
    """
    if sigma is not None and sensor is not None:
        raise ValueError("--sigma must not be given together with --sensor")
    if sigma is not None and not (is_of_edge and sigma == 0):
        unit = "pixels" if is_of_edge else "meters"
        plain_number("sigma", sigma, positive=True, unit=unit)
    if sensor is not None and sensor.endswith(".json"):
        read_json_object(Path(sensor), f"sensor file {sensor!r}")


def check_single_image(page: Path | None, is_single: bool) -> None:
    """Raise a `ValueError` where a page is asked for of several images."""
    if page is not None and not is_single:
        raise ValueError(
            "--page must not be given with several images: it shows the fits of one"
        )


def check_video(video: Path | None) -> None:
    """Raise a `ValueError` unless a video, if one is asked for, can be written."""
    if video is None:
        return
    if video.suffix.lower() not in VIDEOS:
        raise ValueError(f"video must end with .mp4 or .avi, got {str(video)!r}")
    check_output_file(video, "video")


def check_page(page: Path | None) -> None:
    """Raise unless a page, if one is asked for, can be written."""
    if page is None:
        return
    if page.parent.exists():
        check_output_file(page, "page")
    else:
        # It may be the folder of the other files, which is not made yet.
        check_output_folder(page.parent)
