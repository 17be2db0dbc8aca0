"""What is done of a run, written as it is done: a line of JSON for each item.

A run that was cut short anywhere leaves whole lines, but for the last.
"""

__all__ = ["Entry", "Journal", "read_entries"]

import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from impostor_jax.io.atomic import check_output_folder


class Entry(NamedTuple):
    """What came of an item.

    Attributes:
        name: Of the item.
        made_from: Digest of all that it depends on; None where it failed.
        rows: Of the table: a cylinder each, or what is to be said without one.
    """

    name: str
    made_from: str | None
    rows: list[dict[str, Any]]

    @property
    def failed(self) -> str | None:
        """Why an item could not be read, searched or fitted; None where it was."""
        return self.rows[0]["reason"] if self.made_from is None else None


class Journal:
    """A file that grows by a line for each item; the last one of a name counts.

    Args:
        path: Of the file; its folder is made.
        is_resumed: Whether what is there already stays.
    """

    def __init__(self, path: Path, is_resumed: bool):
        check_output_folder(path.parent, (path.name,))
        path.parent.mkdir(parents=True, exist_ok=True)
        self._places: dict[str, tuple[int, str | None]] = {}
        self._file = path.open("r+b" if is_resumed and path.exists() else "w+b")
        end = 0
        for line in self._file:
            entry = _entry_of(line)
            if entry is None:
                break
            self._places[entry.name] = end, entry.made_from
            end += len(line)
        # What follows was not written to its end.
        self._file.truncate(end)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __contains__(self, name: str) -> bool:
        return name in self._places

    def has(self, name: str, made_from: str) -> bool:
        """Whether an item was done, from the same as now."""
        return name in self._places and self._places[name][1] == made_from

    def add(self, entries: Iterable[Entry]) -> None:
        """Write what came of some items."""
        end = self._file.seek(0, 2)
        for entry in entries:
            line = (json.dumps(entry) + "\n").encode()
            self._file.write(line)
            self._places[entry.name] = end, entry.made_from
            end += len(line)
        self._file.flush()

    def entries(self, names: Sequence[str]) -> Iterator[Entry]:
        """What came of items, those that were not done left out."""
        for name in names:
            if name in self._places:
                self._file.seek(self._places[name][0])
                entry = _entry_of(self._file.readline())
                assert entry is not None
                yield entry


def read_entries(path: Path) -> list[Entry]:
    """What a journal holds, as it was begun; a line that is not whole is left out."""
    with path.open("rb") as file:
        found = [entry for entry in map(_entry_of, file) if entry is not None]
    return [*{entry.name: entry for entry in found}.values()]


def _entry_of(line: bytes) -> Entry | None:
    """The entry of a line; None of one that is not whole."""
    try:
        entry = Entry(*json.loads(line)) if line.endswith(b"\n") else None
    except (ValueError, TypeError):
        return None
    return entry
