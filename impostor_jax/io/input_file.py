"""What is read must be a regular file: all else could block, or never end."""

__all__ = ["bytes_left", "opened", "require_file", "sha256_of"]

import contextlib
import hashlib
import io
import os
import stat
from collections.abc import Iterator
from pathlib import Path

OTHER_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
"""What is no regular file, and how it is called."""


def require_file(path: Path, what: str) -> None:
    """Raise unless a path leads to a regular file; `what` names it in errors.

    Raises:
        ValueError: There is nothing, or something else.
    """
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError) as error:
        raise ValueError(f"{what} does not exist") from error
    except OSError as error:
        raise ValueError(f"{what} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ValueError(f"{what} cannot be read: {error}") from error
    for is_kind, name in OTHER_KINDS:
        if is_kind(mode):
            raise ValueError(f"{what} must be a file, got {name}")


@contextlib.contextmanager
def opened(path: Path, what: str) -> Iterator[io.BufferedReader]:
    """Open a regular file to read it; `what` names it in errors.

    Raises:
        ValueError: There is nothing, or something else, or it cannot be read.
    """
    require_file(path, what)
    try:
        with path.open("rb") as file:
            yield file
    except OSError as error:
        raise ValueError(f"{what} cannot be read: {error.strerror}") from error


def bytes_left(file: io.BufferedReader) -> int:
    """Bytes of an open file that are not read yet."""
    return os.fstat(file.fileno()).st_size - file.tell()


def sha256_of(path: Path) -> str:
    """Digest of a file, which tells whether it is another than before."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
