"""Point clouds of the Point Cloud Library: PCD files, organized or not.

A header of lines names the fields of a point; then come the points as text, as packed
records, or field by field and compressed by LZF. The sensor's position is that of
`VIEWPOINT`, in the frame of the points, as PCL's estimates of normals take it; the
default, which programs write that know of none, says nothing.

References:
    The PCD (Point Cloud Data) file format, documentation of PCL 1.15.
"""

__all__ = ["read_pcd"]

import io
import math
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from impostor_jax.io.input_file import bytes_left
from impostor_jax.io.points_text import number_rows

MOST_LINES, LONGEST_LINE = 64, 2**16
"""Of a header; that of a file has eleven, and names a few fields in each."""

NO_VIEWPOINT = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
"""Position and quaternion (w first) that are written where none is known."""

MOST_PACKED = 100
"""Bytes that one of LZF can stand for: three are the most of 264."""

SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
"""Bytes that a number of each type may have."""


class _Header(NamedTuple):
    """What a header says.

    Attributes:
        names: Of the fields.
        types: Of each field, as many numbers as it has, little-endian.
        num_points: With those that are missing.
        origin: Position of the sensor; None where it is not told.
        encoding: "ascii", "binary" or "binary_compressed".
    """

    names: list[str]
    types: list[np.dtype]
    num_points: int
    origin: list[float] | None
    encoding: str

    @property
    def point_bytes(self) -> int:
        """Of a point, where it is no text."""
        return sum(kind.itemsize for kind in self.types)


def read_pcd(
    file: io.BufferedReader, what: str
) -> tuple[Float[np.ndarray, "n 3"], Any]:
    """Read a PCD file that is open at its beginning.

    Args:
        file: Of it.
        what: Names it in errors.

    Returns:
        The points, missing ones as they are stored, and the sensor's position.

    Raises:
        ValueError: It is broken, has no coordinates, or needs python-neo-lzf.
    """
    header = _read_header(file, what)
    columns = [header.names.index(name) for name in "xyz"]
    read = {"ascii": _of_text, "binary": _of_records, "binary_compressed": _of_packed}
    points = read[header.encoding](file, header, columns, bytes_left(file), what)
    return points, header.origin


def _read_header(file: io.BufferedReader, what: str) -> _Header:
    entries: dict[str, list[str]] = {}
    for _ in range(MOST_LINES):
        line = file.readline(LONGEST_LINE).decode("ascii", "replace")
        key, *values = line.partition("#")[0].split() or [""]
        entries[key] = values
        if key == "DATA":
            break
    else:
        raise ValueError(f"{what} is not a readable PCD file: its header has no DATA")
    try:
        return _header_of(entries)
    except (KeyError, ValueError, OverflowError) as error:
        text = f"it lacks {error}" if isinstance(error, KeyError) else str(error)
        raise ValueError(f"{what} is not a readable PCD file: {text}") from error


def _header_of(entries: dict[str, list[str]]) -> _Header:
    names = entries["FIELDS"]
    sizes = [int(size) for size in entries["SIZE"]]
    counts = [int(count) for count in entries.get("COUNT", ["1"] * len(names))]
    kinds = entries["TYPE"]
    if not len(names) == len(sizes) == len(kinds) == len(counts):
        raise ValueError("FIELDS, SIZE, TYPE and COUNT must be of one length")
    if min(counts, default=1) < 1 or sum(counts) > LONGEST_LINE:
        raise ValueError("COUNT must be of positive numbers")
    for size, kind in zip(sizes, kinds, strict=True):
        if size not in SIZES.get(kind, ()):
            raise ValueError(f"no number is of type {kind} and size {size}")
    for name in "xyz":
        if names.count(name) != 1 or counts[names.index(name)] != 1:
            raise ValueError(f"FIELDS must have {name} once")
    (encoding,) = entries["DATA"]
    if encoding not in ("ascii", "binary", "binary_compressed"):
        raise ValueError(
            f"DATA must be ascii, binary or binary_compressed, got {encoding}"
        )
    sides = (int(number) for key in ("WIDTH", "HEIGHT") for number in entries[key])
    num_points = math.prod(sides)
    if num_points < 1 or entries.get("POINTS", [str(num_points)]) != [str(num_points)]:
        raise ValueError("POINTS must be WIDTH times HEIGHT, and at least 1")
    viewpoint = [float(x) for x in entries.get("VIEWPOINT", NO_VIEWPOINT)]
    if len(viewpoint) != len(NO_VIEWPOINT):
        raise ValueError("VIEWPOINT must have seven numbers")
    return _Header(
        names=names,
        types=[
            np.dtype((f"<{kind.lower()}{size}", (count,)))
            for kind, size, count in zip(kinds, sizes, counts, strict=True)
        ],
        num_points=num_points,
        origin=None if viewpoint == NO_VIEWPOINT else viewpoint[:3],
        encoding=encoding,
    )


def _of_text(
    file: io.BufferedReader, header: _Header, columns: list[int], there: int, what: str
) -> Float[np.ndarray, "n 3"]:
    # A number takes two bytes with the space after it.
    firsts = np.cumsum([0, *(kind.shape[0] for kind in header.types)])
    _check_there(header, 2 * header.num_points * int(firsts[-1]), there + 1, what)
    rows = number_rows(
        file, [int(firsts[k]) for k in columns], None, what, header.num_points
    )
    if len(rows) != header.num_points:
        raise ValueError(
            f"{what} must hold {header.num_points} points, got {len(rows)}"
        )
    return rows


def _of_records(
    file: io.BufferedReader, header: _Header, columns: list[int], there: int, what: str
) -> Float[np.ndarray, "n 3"]:
    num_bytes = header.num_points * header.point_bytes
    _check_there(header, num_bytes, there, what)
    record = np.dtype([(str(k), kind) for k, kind in enumerate(header.types)])
    found = np.frombuffer(file.read(num_bytes), record)
    return np.concatenate([found[str(k)] for k in columns], axis=1, dtype=float)


def _of_packed(
    file: io.BufferedReader, header: _Header, columns: list[int], there: int, what: str
) -> Float[np.ndarray, "n 3"]:
    try:
        import lzf
    except ImportError as error:
        raise ValueError(
            f"{what} needs python-neo-lzf: pip install 'impostor-jax[points]'"
        ) from error
    num_bytes = header.num_points * header.point_bytes
    sizes = np.frombuffer(file.read(8), "<u4")
    if len(sizes) < 2 or sizes[1] != num_bytes:
        raise ValueError(
            f"{what} is not a readable PCD file: of {header.num_points} points it must "
            f"pack {num_bytes} bytes"
        )
    packed = int(sizes[0])
    _check_there(header, packed, there - 8, what)
    _check_there(header, num_bytes, MOST_PACKED * packed, what)
    try:
        data = lzf.decompress(file.read(packed), num_bytes)
    except ValueError as error:
        raise ValueError(f"{what} is not a readable PCD file: {error}") from error
    if data is None or len(data) != num_bytes:
        raise ValueError(f"{what} is not a readable PCD file: its points are broken")
    firsts = np.cumsum([0, *(kind.itemsize for kind in header.types)])
    found = [
        np.frombuffer(
            data,
            header.types[k].base,
            header.num_points,
            int(firsts[k]) * header.num_points,
        )
        for k in columns
    ]
    return np.stack(found, axis=1, dtype=float)


def _check_there(header: _Header, needed: int, there: int, what: str) -> None:
    """Raise a `ValueError` where a file is too small for what its header promises."""
    if needed > there:
        raise ValueError(
            f"{what} is cut off: {header.num_points} points of it need {needed} bytes, "
            f"got {max(there, 0)}"
        )
