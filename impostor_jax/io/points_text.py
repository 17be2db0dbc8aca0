"""Point clouds as text: XYZ, ASC, CSV, TXT and PTS files, a point a line.

Columns are divided by commas, semicolons, or spaces and tabs, and the first three are
x, y and z, unless a line of names above them says which. Beside semicolons a comma is a
decimal one. Comments begin with # or //; of a PTS file, or one like it, the first line
is the number of points.
"""

__all__ = ["number_rows", "read_text"]

import io
import itertools
import re
import warnings
from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float

COMMENTS = ["#", "//"]
"""What comments begin with."""

MOST_LINES, LONGEST_LINE = 1000, 2**16
"""Lines above the numbers, and characters of each of them."""


def read_text(file: io.BufferedReader, what: str) -> Float[np.ndarray, "n 3"]:
    """Read the points of a text file that is open at its beginning.

    Args:
        file: Of it.
        what: Names it in errors.

    Raises:
        ValueError: It holds no points, something that is no number, or a line of names
            without x, y and z.
    """
    text = io.TextIOWrapper(file, "utf-8-sig", errors="replace")
    try:
        return _read_lines(text, what)
    finally:
        # Who opened the file closes it.
        text.detach()


def _read_lines(text: io.TextIOWrapper, what: str) -> Float[np.ndarray, "n 3"]:
    columns = [0, 1, 2]
    for _ in range(MOST_LINES):
        line = text.readline(LONGEST_LINE)
        if not line:
            raise ValueError(f"{what} must hold points, got none")
        comment = re.match(r"\s*(#|//)", line)
        found = _columns(line[comment.end() :] if comment else line)
        if found is not None:
            columns = found
        elif not comment and _is_point(line, columns):
            break
        elif not comment and not re.fullmatch(r"\s*\d*\s*", line):
            raise ValueError(
                f"{what} must hold points, or a line that names x, y and z, got "
                f"{line.strip()[:80]!r}"
            )
    else:
        raise ValueError(f"{what} must hold points, got {MOST_LINES} lines without one")
    divider = next((mark for mark in ";," if mark in line), None)
    lines = itertools.chain([line], text)
    if divider == ";":
        lines = (line.replace(",", ".") for line in lines)
    return number_rows(lines, columns, divider, what)


def _columns(line: str) -> list[int] | None:
    """Which columns have the names x, y and z; None where they do not stand there."""
    names = [name.strip("\"' ").lower() for name in re.split(r"[,;\s]+", line.strip())]
    return [names.index(n) for n in "xyz"] if {"x", "y", "z"} <= set(names) else None


def _is_point(line: str, columns: list[int]) -> bool:
    """Whether a line has numbers in three columns."""
    parts = re.split(r"\s*[,;]\s*|\s+", line.strip())
    try:
        return all(isinstance(float(parts[k]), float) for k in columns)
    except (IndexError, ValueError):
        return False


def number_rows(
    lines: Iterable[str] | Iterable[bytes],
    columns: Sequence[int],
    divider: str | None,
    what: str,
    most: int | None = None,
) -> Float[np.ndarray, "n k"]:
    """Numbers of some columns of a text.

    Args:
        lines: Of the text.
        columns: Which are read, counted from 0.
        divider: What stands between them; None for spaces and tabs.
        what: Names the file in errors.
        most: Rows that are read; room is made for as many at once. All if None.

    Raises:
        ValueError: A row is too short, or holds something that is no number.
    """
    try:
        with warnings.catch_warnings():
            # That there are no rows is seen from their number.
            warnings.simplefilter("ignore")
            return np.loadtxt(
                lines, comments=COMMENTS, delimiter=divider, usecols=columns,
                ndmin=2, max_rows=most, encoding="utf-8",
            )  # fmt: skip
    except ValueError as error:
        raise ValueError(f"{what} is not readable: {error}") from error
