"""Programs in C++, compiled when they are first called, and what they print."""

__all__ = ["EIGEN", "Source", "cylinders_of", "detections_of"]

import dataclasses
import functools
import hashlib
import os
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from experiments.find_accuracy.program import MissingProgramError
from impostor_jax.caching import compiled_folder
from impostor_jax.matching import Detection

HERE = Path(__file__).parent

EIGEN = "/usr/include/eigen3"
"""Where Debian has the headers of Eigen."""

MOST_SECONDS = 120.0
"""Of an image: most take about one."""


@dataclasses.dataclass(frozen=True)
class Source:
    """A program in C++.

    Attributes:
        name: Of its file, without the ending.
        flags: Of g++, after the file: libraries, and what else to compile. Folders of
            headers and libraries that g++ does not search are in the environment
            variables `CPATH`, `LIBRARY_PATH` and `LD_LIBRARY_PATH`.
        headers: Folders of headers; those that are not there are left out.
        package: What to install where it does not compile.
    """

    name: str
    flags: tuple[str, ...]
    headers: tuple[str, ...]
    package: str


def cylinders_of(
    source: Source, points: Float[np.ndarray, "*n 3"], settings: Sequence[float]
) -> Float[np.ndarray, "k 8"]:
    """What a program finds: a point of the axis, the axis, radius and inliers of each.

    Nothing if it crashes or takes longer than `MOST_SECONDS`.

    Args:
        source: The program.
        points: In meters.
        settings: Its arguments.

    Raises:
        MissingProgramError: It does not compile here.
    """
    words = [_compiled(source), *map(repr, map(float, settings))]
    try:
        done = subprocess.run(
            words,
            input=points.astype(np.float32).tobytes(),
            capture_output=True,
            check=True,
            timeout=MOST_SECONDS,
        )
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
        print(f"{source.name} found nothing: {error}")
        return np.zeros((0, 8))
    rows = [line.split() for line in done.stdout.decode().splitlines()]
    return np.array(rows, float).reshape(-1, 8)


def detections_of(rows: Float[np.ndarray, "k 8"], fewest: float) -> list[Detection]:
    """Cylinders as detections: the more inliers, the surer.

    Args:
        rows: As `cylinders_of` returns them.
        fewest: Inliers from which the confidence is 0.5 and more.
    """
    return [
        Detection(row[:3], row[3:6], row[6], np.nan, row[7] / (row[7] + fewest))
        for row in rows
    ]


@functools.cache
def _compiled(source: Source) -> Path:
    """The program, in a folder that outlives the process."""
    texts = [path.read_bytes() for path in sorted(HERE.glob("*.[ch]*"))]
    digest = hashlib.sha256(b"".join(texts) + repr(source).encode()).hexdigest()[:16]
    program = compiled_folder().with_name("peers") / f"{source.name}-{digest}"
    if program.exists():
        return program
    program.parent.mkdir(parents=True, exist_ok=True)
    partial = program.with_name(f".{program.name}.{os.getpid()}")
    headers = [f"-I{folder}" for folder in source.headers if Path(folder).is_dir()]
    words = ["g++", "-O3", "-std=c++17", *headers, HERE / f"{source.name}.cpp"]
    try:
        subprocess.run(
            [*words, "-o", partial, *source.flags],
            check=True,
            capture_output=True,
            text=True,
        )
    except (OSError, subprocess.CalledProcessError) as error:
        raise MissingProgramError(
            f"{source.name}.cpp does not compile; it needs g++ and {source.package}: "
            f"{getattr(error, 'stderr', None) or error}"
        ) from error
    partial.replace(program)
    return program
