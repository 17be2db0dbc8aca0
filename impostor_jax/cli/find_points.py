"""What the command `find` does with clouds of points."""

__all__ = ["check_clouds", "find_in_clouds"]

import dataclasses
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from impostor_jax.cli.found_before import count_there, digest_of
from impostor_jax.cli.given import hints_on_stderr, places_of

LABELS = "labels.npy"
"""Number of the cylinder that each point is of, from 1; 0 of none."""

FILES = ("found.json", LABELS)
"""What is written."""


def check_clouds(
    clouds: Sequence[Path], json: Path | None, page: Path | None, sensor: str | None
) -> None:
    """Raise a `ValueError` where a command asks clouds for what images have.

    Args:
        clouds: Of the command.
        json: Of `--json`, like the next ones.
        page: Of `--page`.
        sensor: Of `--sensor`.
    """
    from impostor_jax.io.point_cloud import SUFFIXES

    for path in clouds:
        if path.suffix.lower() not in SUFFIXES:
            raise ValueError(
                f"--camera must be given to search the depth image {str(path)!r}; "
                f"clouds end in one of {', '.join(SUFFIXES)}"
            )
        if not path.is_file():
            raise ValueError(f"point file {str(path)!r} does not exist")
    for flag, value in (("--page", page), ("--sensor", sensor)):
        if value is not None:
            raise ValueError(f"{flag} must be given with depth images alone")
    if json is not None and len(clouds) > 1:
        raise ValueError(
            "--json must not be given with several clouds: each has a found.json of "
            "its own"
        )


def find_in_clouds(
    clouds: Sequence[Path],
    output: Path,
    json: Path | None,
    is_resumed: bool,
    asked: dict[str, Any],
) -> int:
    """Search the clouds of some files and write what is found; the exit code.

    Args:
        clouds: The files.
        output: Folder of what is written.
        json: File for the record of a single cloud; None for one in the folder.
        is_resumed: Whether what is there already is left as it is.
        asked: What a search takes by name; `origin` is that of files without one.
    """
    from tqdm import tqdm

    from impostor_jax.cli.ending import stream_beside
    from impostor_jax.cli.in_turn import found_in_turn
    from impostor_jax.io.atomic import check_output_file, check_output_folder

    places = places_of(clouds, output)
    for place in places:
        check_output_folder(place, FILES)
    if json is not None:
        check_output_file(json, "json")
    tell = partial(tqdm.write, file=stream_beside(json))

    def search(cloud: Path, place: Path) -> int:
        return _found(cloud, place, json, is_resumed, asked, tell)

    return found_in_turn(clouds, places, "cloud", tell, search)


def _found(
    path: Path,
    place: Path,
    json: Path | None,
    is_resumed: bool,
    asked: dict[str, Any],
    tell: Callable[[str], None],
) -> int:
    """Search one cloud and write its files, the record last; how many were found."""
    from impostor_jax.fits.search_points import find_cylinders_in_points
    from impostor_jax.io.atomic import write_atomically, write_json
    from impostor_jax.io.points_file import read_points
    from impostor_jax.io.record import found_in_points_record

    record = json or place / FILES[0]
    effort = dataclasses.asdict(asked["effort"])
    made_from = {"points": path.name, "sha256": digest_of(path)}
    made_from |= asked | {"effort": effort}
    if is_resumed:
        count = count_there(record, [place / LABELS], made_from)
        if count is not None:
            tell(f"{count} found before")
            return count
    cloud = read_points(path)
    if cloud.origin is not None:
        asked = asked | {"origin": cloud.origin}
    start = time.perf_counter()
    with hints_on_stderr():
        found = find_cylinders_in_points(cloud.points, **asked)
    seconds = time.perf_counter() - start
    tell(str(found))
    write_atomically(place / LABELS, partial(_save, found.labels))
    write_json(record, found_in_points_record(found, seconds, made_from))
    return len(found)


def _save(labels: Any, path: Path) -> None:
    import numpy as np

    with path.open("wb") as file:
        np.save(file, labels)
