"""Point clouds of scanners and of other programs: PLY, PCD, LAS, LAZ, text and NPY."""

__all__ = ["read_points"]

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from impostor_jax.arguments import real_number
from impostor_jax.io.input_file import bytes_left, opened
from impostor_jax.io.npy_file import check_npy_bytes, npy_header
from impostor_jax.io.point_cloud import TEXT_SUFFIXES, PointCloud, cloud_of
from impostor_jax.io.points_pcd import read_pcd
from impostor_jax.io.points_ply import read_ply
from impostor_jax.io.points_text import read_text

Found = tuple[Float[np.ndarray, "n 3"], Any]
"""Points and where the sensor stood, in the file's unit."""

MOST_PACKED = 1000
"""Points that a byte of a LAZ file may stand for; of a million equal ones there are
140."""

CHUNK = 2**17
"""Points of a LAS or LAZ file that are read at a time."""


def read_points(path: str | Path, scale: Any = 1.0) -> PointCloud:
    """Read the points of a file, told by its ending.

    Points that are not finite, as of pixels without a reading, are left out.

    Args:
        path: One of these:

            - `.ply`: corners of ASCII or binary files; faces and other properties do
              not count. The position of PCL's `camera` is the sensor's.
            - `.pcd`: ASCII, binary or compressed, organized or not. `VIEWPOINT` is the
              sensor's position, unless it is the default.
            - `.las`, `.laz`: with the file's scale and offset, in double precision.
              A LAZ file that was broken on purpose can end the process: what unpacks it
              trusts its tables.
            - `.xyz`, `.txt`, `.csv`, `.asc`, `.pts`: columns divided by commas,
              semicolons or spaces. x, y and z are those of a line of names, or else the
              first three.
            - `.npy`: (..., 3); or (..., 6), a point and where the sensor stood for it;
              or records with the fields x, y and z.
        scale: Meters in a unit of the file: 0.001 of one in millimeters.

    Returns:
        The points in double precision, and the sensor's position where the file has it.

    Raises:
        ValueError: The file is missing, broken, of another format, or without points;
            or what reads it is not installed (the extra `points`).
    """
    path, scale = Path(path), real_number("scale", scale, positive=True)
    what = f"point file {str(path)!r}"
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise ValueError(f"{what} must end in one of {', '.join(READERS)}")
    # What is not finite, or is not any more, is looked for at the end.
    with opened(path, what) as file, np.errstate(over="ignore", invalid="ignore"):
        points, origin = READERS[suffix](file, what)
        return cloud_of(points, origin, scale, what)


def _read_text(file: io.BufferedReader, what: str) -> Found:
    return read_text(file, what), None


def _read_las(file: io.BufferedReader, what: str) -> Found:
    try:
        import laspy
    except ImportError as error:
        raise ValueError(
            f"{what} needs laspy: pip install 'impostor-jax[points]'"
        ) from error
    try:
        most = MOST_PACKED * bytes_left(file)
        with laspy.open(file, closefd=False) as reader:
            count = reader.header.point_count
            if count > most:
                raise ValueError(f"it cannot hold the {count} points that it says")
            is_packed = reader.header.are_points_compressed
            size = reader.header.point_format.size
            if not is_packed and count * size > bytes_left(file):
                raise ValueError(f"it is cut off: it must hold {count} points")
            chunks = [np.zeros((0, 3)), *map(_scaled, reader.chunk_iterator(CHUNK))]
    except Exception as error:  # It and its decoders raise whatever they meet.
        raise ValueError(f"{what} is not readable: {error}") from error
    points = np.concatenate(chunks)
    if len(points) != count:
        raise ValueError(f"{what} is cut off: it must hold {count} points")
    return points, None


def _scaled(chunk: Any) -> Float[np.ndarray, "n 3"]:
    return np.stack([chunk.x, chunk.y, chunk.z], axis=1, dtype=float)


def _read_npy(file: io.BufferedReader, what: str) -> Found:
    shape, dtype = npy_header(file, what)
    names = dtype.names or ()
    is_records = {"x", "y", "z"} <= set(names)
    kinds = [dtype[name] for name in "xyz"] if is_records else [dtype]
    is_real = all(kind.kind in "fiu" for kind in kinds)
    if not is_real or not (is_records or (shape and shape[-1] in (3, 6))):
        raise ValueError(
            f"{what} must hold numbers of shape (n, 3) or (n, 6), or records with the "
            f"fields x, y and z, got {dtype} of shape {shape}"
        )
    check_npy_bytes(file, shape, dtype, what)
    file.seek(0)
    values = np.load(file, allow_pickle=False)
    if is_records:
        return np.stack([values[name].ravel() for name in "xyz"], 1, dtype=float), None
    rows = values.reshape(-1, shape[-1]).astype(float)
    return rows[:, :3], rows[:, 3:] if shape[-1] == 6 else None


READERS: dict[str, Callable[[io.BufferedReader, str], Found]] = {
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".las": _read_las,
    ".laz": _read_las,
    ".npy": _read_npy,
    **dict.fromkeys(TEXT_SUFFIXES, _read_text),
}
"""By the endings of files."""
