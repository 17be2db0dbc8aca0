"""Datasets, and what programs find in them: what is kept need not be run again.

What a program tells of an image is a file of its own, so that a run that was
interrupted goes on where it was. Its folder is named after the sources of the program:
one that has changed is run anew, the others are not.
"""

__all__ = ["Job", "Runs", "kept_folder"]

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
from experiments.find_accuracy.program import Program
from experiments.find_accuracy.programs import OUR_SOURCES, PROGRAMS, fit_true_masks
from experiments.timing import ROOT
from impostor_jax.caching import compiled_folder
from impostor_jax.io.atomic import write_atomically
from impostor_jax.io.dataset import (
    MANIFEST,
    Dataset,
    read_dataset,
    read_manifest,
    sensor_of,
)
from impostor_jax.matching import Detection

SHARD = 20
"""Images of a shard: what is lost at most if the making of a dataset is interrupted."""

CHUNK = 4
"""Images that a process is given at a time."""

Job = Callable[[ij.LabeledImage, ij.AbstractDepthNoise], Float[np.ndarray, "..."]]
"""What is asked of an image and its sensor. Its name is found by other processes."""


def kept_folder() -> Path:
    """Where runs are kept, in the user's cache folder."""
    return compiled_folder().with_name("find_accuracy")


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
        entry = PROGRAMS[program]
        job = functools.partial(_find, entry.function)
        return self._detections(program, job, entry.sources)

    def fits_to_masks(self) -> list[list[Detection]]:
        """Our fits of the cylinders of each image to their true masks."""
        return self._detections("true masks", _fit, OUR_SOURCES)

    def seconds(self, program: str, count: int) -> Float[np.ndarray, "count 2"]:
        """Wall and processor seconds of some images, one after the other.

        Each is searched twice, of which the second time counts: nothing is compiled.
        """
        entry = PROGRAMS[program]
        job = functools.partial(_time, entry.function)
        return np.array(
            self.of_each(f"seconds of {program}", job, entry.sources, count, 1)
        )

    def _detections(
        self, name: str, job: Job, sources: tuple[str, ...]
    ) -> list[list[Detection]]:
        return [
            [Detection(row[:3], row[3:6], *row[6:].tolist()) for row in rows]
            for rows in self.of_each(name, job, sources)
        ]

    def of_each(
        self,
        name: str,
        job: Job,
        sources: tuple[str, ...],
        count: int | None = None,
        workers: int | None = None,
    ) -> list[Float[np.ndarray, "..."]]:
        """What a job tells of each image; it is only called where that is not kept.

        Args:
            name: Of the job.
            job: Called in `workers` processes, or in this one if that is 1.
            sources: Folders whose files tell whether it has changed since it ran.
            count: Of the first images; all by default.
            workers: As of the runs by default.
        """
        count, workers = count or self.count, workers or self.workers
        folder = self._folder / f"{name}-{_digest(sources)}"
        folder.mkdir(parents=True, exist_ok=True)
        missing = [k for k in range(count) if not _path(folder, k).exists()]
        call = functools.partial(_keep, job, self.dataset, folder)
        if workers == 1:
            for k in missing:
                call(k)
        elif missing:
            context = multiprocessing.get_context("spawn")
            threads = max(1, len(os.sched_getaffinity(0)) // workers)
            with ProcessPoolExecutor(workers, context, _begin, (threads,)) as pool:
                _all(pool.map(call, missing, chunksize=CHUNK))
        return [np.load(_path(folder, k)) for k in range(count)]


def _begin(threads: int) -> None:
    """Give a process few threads of XLA: they would wait for those of the others."""
    os.environ.setdefault("PJRT_NPROC", str(threads))


def _all(results: Iterable[None]) -> None:
    for _ in results:
        pass


def _keep(job: Job, dataset: Path, folder: Path, number: int) -> None:
    sensor, images = _opened(dataset)
    values = job(images[number], sensor)

    def save(partial: Path) -> None:
        with partial.open("wb") as file:
            np.save(file, values)

    write_atomically(_path(folder, number), save)


def _find(
    function: Program, image: ij.LabeledImage, sensor: ij.AbstractDepthNoise
) -> Float[np.ndarray, "k 10"]:
    return _rows(function(image.depth, image.pinhole, sensor))


def _fit(
    image: ij.LabeledImage, sensor: ij.AbstractDepthNoise
) -> Float[np.ndarray, "k 10"]:
    return _rows(fit_true_masks(image, sensor))


def _rows(found: Iterable[Detection]) -> Float[np.ndarray, "k 10"]:
    rows = [[*one.center, *one.axis, *one[2:]] for one in found]
    return np.array(rows, float).reshape(-1, 10)


def _time(
    function: Program, image: ij.LabeledImage, sensor: ij.AbstractDepthNoise
) -> Float[np.ndarray, "2"]:
    spent = np.zeros(2)
    for _ in range(2):
        before = _clocks()
        function(image.depth, image.pinhole, sensor)
        spent = _clocks() - before
    return spent


def _clocks() -> Float[np.ndarray, "2"]:
    """Wall time, and processor time of this process and of those that it waited for."""
    return np.array([time.perf_counter(), sum(os.times()[:4])])


@functools.lru_cache(maxsize=1)
def _opened(dataset: Path) -> tuple[ij.AbstractDepthNoise, Dataset]:
    return sensor_of(read_manifest(dataset)), read_dataset(dataset)


def _path(folder: Path, number: int) -> Path:
    return folder / f"{number:06d}.npy"


@functools.cache
def _digest(sources: tuple[str, ...]) -> str:
    """Of all code in some folders of the repository."""
    digest = hashlib.sha256()
    for source in sources:
        for path in sorted((ROOT / source).rglob("*")):
            if path.suffix in (".py", ".cpp", ".h"):
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
