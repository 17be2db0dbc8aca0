"""Writing a file under a temporary name, so that no reader meets half of one.

Only a regular file is replaced. What a link leads to is, the link stays; a device or a
pipe is written to; and "-", or another name of the standard output, is printed.
"""

__all__ = [
    "check_output_file",
    "check_output_folder",
    "is_standard_output",
    "write_atomically",
    "write_json",
    "write_text",
]

import errno
import json
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

STANDARD_OUTPUT = Path("-")
"""What stands for the standard output on a command line."""


def is_standard_output(path: Path) -> bool:
    """Whether a name is "-", or of what this process prints to.

    A file that the shell made for the output must not be replaced, either: what is
    printed would go to the old one, which has no name any more.
    """
    if path == STANDARD_OUTPUT:
        return True
    if sys.stdout is None:
        return False
    try:
        return os.path.samestat(path.stat(), os.fstat(1))
    except OSError:
        return False


def check_output_file(path: Path, name: str = "output") -> None:
    """Raise unless a file can be written, which is not done yet.

    Args:
        path: Of the file; its folder must be there.
        name: Of the argument, for the error.

    Raises:
        ValueError: The folder is not there, or the path is of a folder.
        OSError: The file or the folder must not be written to.
    """
    if is_standard_output(path):
        _require_output()
        return
    mode = _mode_of(path)
    if mode is not None and stat.S_ISDIR(mode):
        raise ValueError(f"{name} must be a file, got the folder {str(path)!r}")
    if mode is not None and not os.access(path, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    if mode is not None and not stat.S_ISREG(mode):
        return
    folder = Path(os.path.realpath(path)).parent
    if not folder.is_dir():
        raise ValueError(
            f"{name} must be a file in a folder that is there, got {str(path)!r}"
        )
    _check_folder(folder)


def check_output_folder(folder: Path, files: Sequence[str] = ()) -> None:
    """Raise unless files can be written in a folder, which may be made for them.

    Nothing is made yet, so that nothing is left where the input turns out bad.

    Args:
        folder: Of the files.
        files: Their names.

    Raises:
        ValueError: One of the files is a folder, or the folder is a file.
        OSError: They must not be written.
    """
    if _mode_of(folder) is not None:
        if not folder.is_dir():
            raise ValueError(f"output must be a folder, got the file {str(folder)!r}")
        _check_folder(folder)
        for file in files:
            check_output_file(folder / file)
        return
    above = folder.absolute().parent
    while _mode_of(above) is None:
        above = above.parent
    _check_folder(above)


def _check_folder(folder: Path) -> None:
    """Raise an `OSError` unless a file can be made in a folder."""
    # Rights alone do not tell of a file system that takes no files.
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        # It names the temporary file, of which the caller knows nothing.
        reason = f"no file can be made in the folder ({error.strerror})"
        raise OSError(error.errno, reason, str(folder)) from error


def _require_output() -> None:
    """Raise an `OSError` where the standard output is closed."""
    if sys.stdout is None:
        raise OSError(errno.EBADF, "the standard output is closed")


def _mode_of(path: Path) -> int | None:
    """Kind and rights of what a path leads to; None where nothing is there."""
    try:
        return path.stat().st_mode
    except FileNotFoundError:
        return None


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Call `write` with a temporary path, then give the file its name.

    Args:
        path: Final name; its folder is made where it is missing.
        write: Writes the whole file to the path that it is given.
    """
    mode = None if path == STANDARD_OUTPUT else _mode_of(path)
    is_special = mode is not None and not stat.S_ISREG(mode)
    if is_standard_output(path) or is_special:
        # The suffix stays, since image writers choose their format by it.
        with tempfile.TemporaryDirectory() as folder:
            partial = Path(folder) / path.name
            write(partial)
            _write_through(path, partial.read_bytes())
        return
    target = Path(os.path.realpath(path))
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(
        prefix=f".{target.name}.", dir=target.parent
    ) as folder:
        partial = Path(folder) / path.name
        write(partial)
        if mode is not None:
            shutil.copymode(target, partial)
        os.replace(partial, target)


def _write_through(path: Path, data: bytes) -> None:
    """Write to what is no regular file, or to the standard output."""
    if is_standard_output(path):
        _require_output()
        sys.stdout.flush()
        sys.stdout.buffer.write(data)
        sys.stdout.flush()
        return
    with open(os.open(path, os.O_WRONLY), "wb", buffering=0) as file:
        try:
            while data:
                data = data[file.write(data) :]
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(path)) from error


def write_json(path: Path, record: Any) -> None:
    """Write a JSON file; NaN and infinity are refused, since JSON has none."""
    text = json.dumps(record, indent=2, allow_nan=False) + "\n"
    write_text(path, text)


def write_text(path: Path, text: str) -> None:
    """Write a text file."""
    write_atomically(path, lambda partial: partial.write_text(text))
