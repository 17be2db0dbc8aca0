"""Files that hold a camera: this package's JSON, ROS's YAML and COLMAP's text.

Nothing here needs JAX, so that a command can refuse a file before JAX starts.
"""

__all__ = [
    "REQUIRED",
    "check_camera_record",
    "read_camera_record",
    "size_of_record",
]

from pathlib import Path
from typing import Any

from impostor_jax.io.foreign_camera import camera_arguments
from impostor_jax.io.input_file import opened
from impostor_jax.io.json_file import check_keys, read_json_object
from impostor_jax.io.spherical_record import ANGLES, angles_of, check_spherical_record
from impostor_jax.plain_arguments import image_size

REQUIRED = ("fx", "fy", "cx", "cy", "width", "height")
OPTIONAL = ("depth_scale_m", "distortion", "fisheye")

LARGEST_SCALE_M = 1e6
"""Meters a unit: a thousand kilometers."""

MOST_BYTES = 2**18
"""Of a YAML or a text file: a YAML of a megabyte takes seconds."""

MAX_YAML_DEPTH = 10
"""Deepest nesting; CameraInfo needs three."""


def read_camera_record(path: Path) -> dict[str, Any]:
    """Read the keys of a camera file, from any of the formats.

    The ending decides: `.yaml` and `.yml` are ROS's, `.txt` is COLMAP's `cameras.txt`
    with one camera, and everything else is JSON.

    Raises:
        ValueError: The file is missing or broken, or lacks a key or holds one that is
            unknown; the size is out of range; or PyYAML is needed and missing.
    """
    what = f"camera file {str(path)!r}"
    suffix = path.suffix.lower()
    if suffix in (".yaml", ".yml"):
        record = _converted(_read_yaml(path, what), what)
    elif suffix == ".txt":
        record = _converted(_only_line(path, what), what)
    else:
        record = read_json_object(path, what)
    check_camera_record(record, what)
    return record


def check_camera_record(record: dict[str, Any], what: str) -> None:
    """Raise a `ValueError` unless a record has the keys of a camera file.

    Args:
        record: As it was read; its numbers are looked at where the camera is made.
        what: Names it in errors.
    """
    if "model" in record:
        check_spherical_record(record, what)
    else:
        check_keys(record, REQUIRED, (*REQUIRED, *OPTIONAL), what)
    try:
        scale, fisheye = record.get("depth_scale_m"), record.get("fisheye", False)
        if scale is not None and not _is_scale(scale):
            raise ValueError(
                "depth_scale_m must be a positive number of meters a unit, got "
                f"{scale!r}"
            )
        if not isinstance(fisheye, bool):
            raise ValueError(f"fisheye must be true or false, got {fisheye!r}")
        image_size(*size_of_record(record))
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from error


def size_of_record(record: dict[str, Any]) -> tuple[Any, Any]:
    """Width and height of the images of a camera's record, which has its keys."""
    if "model" in record:
        elevation, azimuth = (angles_of(record, name) for name in ANGLES)
        return len(azimuth), len(elevation)
    return record["width"], record["height"]


def _is_scale(scale: Any) -> bool:
    """Whether a value of JSON's is a scale, with which 16 bits stay in range."""
    # True is a whole number to Python, and a mistake in a file.
    is_number = isinstance(scale, int | float) and not isinstance(scale, bool)
    return is_number and 0 < scale <= LARGEST_SCALE_M


def _converted(given: Any, what: str) -> dict[str, Any]:
    try:
        return camera_arguments(given)
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from error


def _text(path: Path, what: str) -> str:
    with opened(path, what) as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise ValueError(f"{what} must have at most {MOST_BYTES} bytes")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{what} is not readable text") from error


def _read_yaml(path: Path, what: str) -> Any:
    """The first document of a YAML file: `ros2 topic echo` prints one a message."""
    text = _text(path, what)
    try:
        import yaml
    except ImportError as error:
        raise ValueError(
            f"{what} needs PyYAML: pip install 'impostor-jax[yaml]'"
        ) from error
    try:
        _check_events(yaml, text, what)
        record = next(iter(yaml.safe_load_all(text)), None)
    except yaml.YAMLError as error:
        raise ValueError(f"{what} is not readable YAML") from error
    if not isinstance(record, dict):
        raise ValueError(f"{what} must hold ROS's CameraInfo")
    return record


def _check_events(yaml: Any, text: str, what: str) -> None:
    """Raise where a document is nested too deep, or grows by names for its parts."""
    depth = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        if isinstance(event, yaml.DocumentEndEvent):
            return
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        # Read by recursion; and of a few names, each of the next, grow gigabytes.
        if depth > MAX_YAML_DEPTH or isinstance(event, yaml.AliasEvent):
            raise ValueError(f"{what} must hold ROS's CameraInfo")


def _only_line(path: Path, what: str) -> str:
    """The camera of a `cameras.txt`, whose comments begin with #."""
    lines = [line.strip() for line in _text(path, what).splitlines()]
    cameras = [line for line in lines if line and not line.startswith("#")]
    if len(cameras) != 1:
        raise ValueError(
            f"{what} must hold one camera, got {len(cameras)}; ij.camera_from takes "
            "any of its lines"
        )
    return cameras[0]
