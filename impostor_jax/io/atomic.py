"""Writing a file under a temporary name, so that no reader meets half of one."""

__all__ = ["write_atomically", "write_json", "write_text"]

import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Call `write` with a temporary path, then give the file its name.

    Args:
        path: Final name; its folder is made where it is missing.
        write: Writes the whole file to the path that it is given.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    # The suffix stays, since image writers choose their format by it.
    with tempfile.TemporaryDirectory(
        prefix=f".{path.name}.", dir=path.parent
    ) as folder:
        partial = Path(folder) / path.name
        write(partial)
        os.replace(partial, path)


def write_json(path: Path, record: Any) -> None:
    """Write a JSON file; NaN and infinity are refused, since JSON has none."""
    text = json.dumps(record, indent=2, allow_nan=False) + "\n"
    write_text(path, text)


def write_text(path: Path, text: str) -> None:
    """Write a text file."""
    write_atomically(path, lambda partial: partial.write_text(text))
