"""What an interrupted run of the command `find` has left, for `--resume`."""

__all__ = ["count_there", "digest_of"]

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any


def digest_of(path: Path) -> str:
    """SHA-256 of a file, which tells whether it is another than before."""
    with path.open("rb") as data:
        return hashlib.file_digest(data, "sha256").hexdigest()


def count_there(
    record: Path, beside: Sequence[Path], made_from: dict[str, Any]
) -> int | None:
    """How many cylinders were found where all files are there; else None.

    Args:
        record: File of the record.
        beside: The others.
        made_from: What the files depend on; where the record says otherwise, they are
            of another run.
    """
    import json

    from impostor_jax.find.found import FOUND_VERSION
    from impostor_jax.io.json_file import check_version, read_json_object

    if not all(path.is_file() for path in (record, *beside)):
        return None
    what = f"record {str(record)!r}"
    there = read_json_object(record, what)
    check_version(there, FOUND_VERSION, what)
    # As JSON has it, lists for tuples.
    if there.get("made_from") != json.loads(json.dumps(made_from)):
        return None
    return len(there["cylinders"])
