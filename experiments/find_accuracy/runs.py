"""Datasets, and what programs find in them: what is kept need not be run again.

Each image's detections are a file of their own, so that a run that was interrupted goes
on where it was. Their folder is named after the sources of the program: one that has
changed is run anew.
"""

__all__ = ["Runs"]

import dataclasses
import functools
import hashlib
import multiprocessing
import os
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from jaxtyping import Float

import impostor_jax as ij
from data_synth.generate import generate, resume
from data_synth.preset import Preset
from experiments.find_accuracy.program import Detection
from experiments.find_accuracy.programs import PROGRAMS, TRUE_MASKS, fit_true_masks
from experiments.timing import ROOT
from impostor_jax.io.atomic import write_atomically
from impostor_jax.io.dataset import (
    MANIFEST,
    Dataset,
    read_dataset,
    read_manifest,
    sensor_of,
)

SHARD = 20
"""Images of a shard: what is lost at most if the making of a dataset is interrupted."""

CHUNK = 4
"""Images that a process is given at a time."""


@dataclasses.dataclass(frozen=True)
class Runs:
    """Runs of programs on one dataset.

    Attributes:
        preset: What the dataset draws.
        count: Number of its images.
        seed: Of all that is drawn.
        home: Folder of what is kept.
        workers: Processes that make it, and that programs run in.
    """

    preset: Preset
    count: int
    seed: int
    home: Path
    workers: int

    @functools.cached_property
    def _folder(self) -> Path:
        record = repr(self.preset.record()) + _digest(("data_synth",))
        digest = hashlib.sha256(record.encode()).hexdigest()[:16]
        return self.home / f"{digest}-{self.seed}-{self.count}"

    @functools.cached_property
    def dataset(self) -> Path:
        """Folder of the dataset, which is made if it is not there."""
        folder = self._folder / "dataset"
        if (folder / MANIFEST).exists():
            resume(folder, workers=self.workers, allow_other_maker=True)
        else:
            generate(
                self.preset,
                self.count,
                folder,
                self.seed,
                shard_size=SHARD,
                clean=False,
                workers=self.workers,
            )
        return folder

    def detections(self, program: str) -> list[list[Detection]]:
        """What a program finds in each image.

        Raises:
            MissingProgramError: It is not installed.
        """
        folder = self._kept(program, "found")
        self._run(_find, program, folder, self.count, self.workers)
        return [
            [Detection(row[:3], row[3:6], *row[6:].tolist()) for row in rows]
            for rows in _read(folder, self.count)
        ]

    def seconds(self, program: str, count: int) -> Float[np.ndarray, "count 2"]:
        """Wall and processor seconds of some images, one after the other.

        Each is searched twice, of which the second time counts: nothing is compiled.
        """
        folder = self._kept(program, "seconds")
        self._run(_time, program, folder, count, 1)
        return np.array(_read(folder, count))

    def _kept(self, program: str, what: str) -> Path:
        sources = ("impostor_jax",)
        if program != TRUE_MASKS:
            sources = PROGRAMS[program].sources
        return self._folder / f"{program}-{_digest(sources)}" / what

    def _run(
        self,
        function: Callable[[Path, str, Path, int], None],
        program: str,
        folder: Path,
        count: int,
        workers: int,
    ) -> None:
        """Let processes do what is missing; this one if one of them is enough."""
        folder.mkdir(parents=True, exist_ok=True)
        missing = [k for k in range(count) if not _path(folder, k).exists()]
        call = functools.partial(function, self.dataset, program, folder)
        if workers == 1:
            for k in missing:
                call(k)
        elif missing:
            context = multiprocessing.get_context("spawn")
            threads = max(1, len(os.sched_getaffinity(0)) // workers)
            with ProcessPoolExecutor(workers, context, _begin, (threads,)) as pool:
                _all(pool.map(call, missing, chunksize=CHUNK))


def _begin(threads: int) -> None:
    """Give a process few threads of XLA: they would wait for those of the others."""
    os.environ.setdefault("PJRT_NPROC", str(threads))


def _all(results: Iterable[None]) -> None:
    for _ in results:
        pass


def _find(dataset: Path, program: str, folder: Path, number: int) -> None:
    image, sensor = _image(dataset, number)
    if program == TRUE_MASKS:
        found = fit_true_masks(image, sensor)
    else:
        found = PROGRAMS[program].function(image.depth, image.camera, sensor)
    rows = [[*one.center, *one.axis, *one[2:]] for one in found]
    _write(_path(folder, number), np.array(rows, float).reshape(-1, 10))


def _time(dataset: Path, program: str, folder: Path, number: int) -> None:
    image, sensor = _image(dataset, number)
    spent = np.zeros(2)
    for _ in range(2):
        before = _clocks()
        PROGRAMS[program].function(image.depth, image.camera, sensor)
        spent = _clocks() - before
    _write(_path(folder, number), spent)


def _clocks() -> Float[np.ndarray, "2"]:
    """Wall time, and processor time of this process and of those that it waited for."""
    return np.array([time.perf_counter(), sum(os.times()[:4])])


@functools.lru_cache(maxsize=1)
def _opened(dataset: Path) -> tuple[ij.AbstractDepthNoise, Dataset]:
    return sensor_of(read_manifest(dataset)), read_dataset(dataset)


def _image(dataset: Path, number: int) -> tuple[ij.LabeledImage, ij.AbstractDepthNoise]:
    sensor, images = _opened(dataset)
    return images[number], sensor


def _path(folder: Path, number: int) -> Path:
    return folder / f"{number:06d}.npy"


def _write(path: Path, values: Float[np.ndarray, "..."]) -> None:
    def save(partial: Path) -> None:
        with partial.open("wb") as file:
            np.save(file, values)

    write_atomically(path, save)


def _read(folder: Path, count: int) -> list[Float[np.ndarray, "..."]]:
    return [np.load(_path(folder, k)) for k in range(count)]


@functools.cache
def _digest(sources: tuple[str, ...]) -> str:
    """Of all code in some folders of the repository."""
    digest = hashlib.sha256()
    for source in sources:
        for path in sorted((ROOT / source).rglob("*")):
            if path.suffix in (".py", ".cpp", ".h"):
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
