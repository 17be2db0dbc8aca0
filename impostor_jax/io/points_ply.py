"""Point clouds of PLY files: corners alone, so that no face is ever read.

A header of lines names elements and their properties; then come the elements in order,
as lines of text or as packed records. Lists, as of a face's corners, are of no fixed
size, so those of a binary file are only read past where no corner follows.

References:
    G. Turk (1994), The PLY Polygon File Format.
"""

__all__ = ["read_ply"]

import io
import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from impostor_jax.io.input_file import bytes_left
from impostor_jax.io.points_text import number_rows

MOST_LINES, LONGEST_LINE = 10000, 2**16
"""Of a header; comments may be many."""

ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
"""Of bytes, by the name of the format; text has none."""

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4",
    "uint": "u4", "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1",
    "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4",
    "float64": "f8",
}  # fmt: skip
"""Of numbers, by their names of either generation."""

WANTED = {"vertex": ("x", "y", "z"), "camera": ("view_px", "view_py", "view_pz")}
"""Elements that are read, and their properties: PCL writes where the sensor was, and 0
where it does not know."""

Rows = Float[np.ndarray, "n 3"]


class _Element(NamedTuple):
    """An element of the header: its properties, None for the type of a list."""

    name: str
    num_rows: int
    properties: list[tuple[str, str | None]]

    def columns(self, what: str) -> list[int]:
        """Where the wanted properties stand.

        Raises:
            ValueError: One is missing, or stands behind a list.
        """
        names = [name for name, _ in self.properties]
        if missing := [name for name in WANTED[self.name] if name not in names]:
            raise ValueError(f"{what}: {self.name} lacks {', '.join(missing)}")
        columns = [names.index(name) for name in WANTED[self.name]]
        if any(kind is None for _, kind in self.properties[: max(columns) + 1]):
            raise ValueError(f"{what}: lists before x, y and z are not read")
        return columns


def read_ply(file: io.BufferedReader, what: str) -> tuple[Rows, list[float] | None]:
    """Read the corners of a PLY file that is open at its beginning.

    Args:
        file: Of it.
        what: Names it in errors.

    Returns:
        The corners, and the sensor's position where PCL wrote one.

    Raises:
        ValueError: It is broken, or has no corners.
    """
    order, elements = _read_header(file, what)
    found: dict[str, Rows] = {}
    for element in elements:
        is_known = not WANTED.keys() - found.keys()
        has_list = any(kind is None for _, kind in element.properties)
        if is_known or (order and has_list and "vertex" in found and element.num_rows):
            break
        if order:
            rows = _of_records(file, element, order, bytes_left(file), what)
        else:
            rows = _of_lines(file, element, what)
        if rows is not None:
            found[element.name] = rows
    if "vertex" not in found:
        raise ValueError(f"{what} must hold corners, got no element vertex")
    origins = found.get("camera", np.zeros((0, 3)))
    return found["vertex"], origins[0].tolist() if origins.any() else None


def _read_header(file: io.BufferedReader, what: str) -> tuple[str, list[_Element]]:
    """Order of bytes and elements."""
    if file.readline(LONGEST_LINE).strip() != b"ply":
        raise ValueError(f"{what} is not a readable PLY file: it begins with no 'ply'")
    order, elements = None, []
    for _ in range(MOST_LINES):
        line = file.readline(LONGEST_LINE).decode("ascii", "replace")
        try:
            match line.split():
                case ["end_header"] if order is not None:
                    return order, elements
                case ["format", name, _]:
                    order = ORDERS[name]
                case ["element", name, count]:
                    if int(count) < 0:
                        raise ValueError("a count is negative")
                    elements.append(_Element(name, int(count), []))
                case ["property", "list", _, _, name]:
                    elements[-1].properties.append((name, None))
                case ["property", kind, name]:
                    elements[-1].properties.append((name, TYPES[kind]))
                case ["comment" | "obj_info", *_]:
                    pass
                case _:
                    raise ValueError("its header has no end" if not line else "")
        except (KeyError, IndexError, ValueError) as error:
            text = f"it has the line {line.strip()[:80]!r}" if line else str(error)
            raise ValueError(f"{what} is not a readable PLY file: {text}") from error
    raise ValueError(f"{what} is not a readable PLY file: its header has no end")


def _of_lines(file: io.BufferedReader, element: _Element, what: str) -> Rows | None:
    """The wanted properties of an element's lines, which are read past; else None."""
    lines = itertools.islice(file, element.num_rows)
    if element.name not in WANTED:
        for _ in lines:
            pass
        return None
    rows = number_rows(lines, element.columns(what), None, what)
    if len(rows) != element.num_rows:
        raise ValueError(
            f"{what} is cut off: {element.name} must have {element.num_rows} lines, "
            f"got {len(rows)}"
        )
    return rows


def _of_records(
    file: io.BufferedReader, element: _Element, order: str, there: int, what: str
) -> Rows | None:
    """The same of an element's records."""
    kinds = [kind for _, kind in element.properties]
    if element.num_rows and None in kinds:
        raise ValueError(f"{what}: lists before or among the corners are not read")
    record = np.dtype([(str(k), f"{order}{kind}") for k, kind in enumerate(kinds)])
    needed = element.num_rows * record.itemsize
    if needed > there:
        raise ValueError(
            f"{what} is cut off: {element.num_rows} of {element.name} need {needed} "
            f"bytes, got {there}"
        )
    if element.name not in WANTED:
        file.seek(needed, io.SEEK_CUR)
        return None
    columns = element.columns(what)
    values = np.frombuffer(file.read(needed), record)
    return np.stack([values[str(k)] for k in columns], axis=1, dtype=float)
