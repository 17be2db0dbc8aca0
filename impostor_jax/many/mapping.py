"""Do a task on many images or clouds: in turn, in processes, or on a cluster."""

__all__ = ["FAILED", "JOURNAL", "done_on", "map_images"]

import contextlib
import hashlib
import itertools
import json
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import Any

import impostor_jax
from impostor_jax.effort import Effort, effort_of
from impostor_jax.fit.options import Errors, MaskMeaning, Options, Scale
from impostor_jax.io.atomic import check_output_folder
from impostor_jax.io.camera_file import CameraFile, FiledCamera
from impostor_jax.many.inputs import items_of
from impostor_jax.many.items import LABELS, MASK, AbstractItem, CloudFile
from impostor_jax.many.journal import Entry, Journal
from impostor_jax.many.tasks import FITS, AbstractTask, FindTask, FitTask
from impostor_jax.plain_arguments import one_of
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.workers import done_by, number_of_workers

CHUNK = 8
"""Items that a process is handed at once; what it has not told of is lost with it."""

JOURNAL = "results.jsonl"
"""File of what is done of a run, in its folder."""

FAILED = "failed"
"""Status of an image that could not be read, searched or fitted."""


def map_images(
    images: str | Path | Sequence[str | Path],
    camera: str | Path | CameraFile | FiledCamera | None = None,
    task: str = "find",
    *,
    masks: str | Path | Sequence[str | Path] = (),
    labels: str | Path | Sequence[str | Path] = (),
    output: str | Path | None = None,
    resume: bool = False,
    files: bool = False,
    workers: int = 1,
    executor: Executor | None = None,
    sigma: Any = None,
    prior: Mapping[str, Any] | None = None,
    effort: Effort | str = "balanced",
    origin: Any = None,
    radius_range: tuple[float, float] | None = None,
    min_arc: float | None = None,
    min_pixels: int | None = None,
    min_points: int | None = None,
    initial: AbstractPrimitive | None = None,
    fixed: Sequence[str] = (),
    mask_meaning: MaskMeaning | None = None,
    scale: Scale | None = None,
    errors: Errors | None = None,
) -> Iterator[Entry]:
    """Find cylinders in many images, or fit one to each, and tell of each when done.

        for one in ij.map_images("frames", "camera.json", workers=2, sigma=0.002):
            for row in one.rows:
                print(one.name, row["status"], row.get("radius_m"))

    An image that cannot be read or fitted has a row with the status `failed` and the
    reason; the others are done all the same. With `workers` a script must keep what it
    does under `if __name__ == "__main__":`, since processes import it again.

    Args:
        images: Depth images, folders, lists, datasets, or patterns of them; or clouds:
            as `impostor-jax find` takes them.
        camera: Camera file of the images, or a pattern such as `{folder}/camera.json`
            of one for each; or a camera, of images in meters. None of clouds, and of
            datasets that have their cameras.
        task: "find", or what is fitted: "cylinder", "sphere", "frustum", "tube", "box".
        masks: Of what is fitted: one each, a folder of PNG files of the images' names,
            or a pattern.
        labels: Likewise label images, of which each object is fitted.
        output: Folder in which `results.jsonl` grows as images are done; none if None.
        resume: Whether images are left out that are in there, done from the same files
            with the same options and version; they are told of first.
        files: Whether each image has its record and pictures in a folder of its name
            in `output`, too.
        workers: Number of processes; with 1 the work is done in this one.
        executor: What runs the work instead, such as
            `dask.distributed.Client.get_executor(pure=False)`.
        sigma: Standard deviation of a reading in meters, or a noise model of the
            sensor; measured in each image or cloud if None.
        prior: Expected value and standard deviation of parameters by name, in meters
            and radians, as in `fit_cylinder`; none by default.
        effort: "fast", "balanced" (the default), "exact" or an `Effort`.
        origin: (3,), where the sensor stood, in meters, of clouds whose file does not
            say it.
        radius_range: Of what is found: smallest and largest radius, in meters; like the
            next three as in `find_cylinders`, whose default None stands for.
        min_arc: Smallest angle about its axis over which it is seen, in radians.
        min_pixels: Fewest pixels of it, in an image.
        min_points: Fewest points of it, in a cloud.
        initial: Start of what is fitted, in the world frame; found if None.
        fixed: Names of parameters that keep their value in it; none by default.
        mask_meaning: "region" or "outline"; like the next two as in `fit_cylinder`,
            whose default None stands for.
        scale: "estimated" or "fixed".
        errors: "independent" or "correlated".

    Returns:
        What came of each, when it is done: its `name`, the `rows` of its cylinders as
        they stand in the table of `impostor-jax find`, and why it `failed`, or None. In
        the order of the images with one worker, else in that in which they are ready.
        Leaving the loop ends the work.

    Raises:
        ValueError: An argument is bad, or stands for no image.
    """
    one_of("task", task, ("find", *FITS))
    if masks and labels:
        raise ValueError("masks must not be given together with labels")
    if (resume or files) and output is None:
        raise ValueError("output must be given with resume or files, got None")
    file = CameraFile(camera, None) if isinstance(camera, FiledCamera) else camera
    beside, meaning = (labels, LABELS) if labels else (masks, MASK)
    if beside and task == "find":
        raise ValueError(f"{meaning} must be given with what is fitted alone")
    if isinstance(beside, str | Path):
        beside = [beside]
    items = items_of(images, file, beside, meaning)
    meant = mask_meaning or "region", scale or "estimated"
    chosen = Options(fixed, prior, *meant, errors, effort_of(effort))
    of_search = {
        "radius_range": radius_range,
        "min_arc": min_arc,
        "min_pixels": min_pixels,
        "min_points": min_points,
    }
    of_fit = {
        "initial": initial,
        "fixed": tuple(fixed) or None,
        "mask_meaning": mask_meaning,
        "scale": scale,
        "errors": errors,
    }
    own, others = (of_search, of_fit) if task == "find" else (of_fit, of_search)
    _refuse(others, f"task {task!r}")
    if isinstance(items[0], CloudFile):
        _refuse({"min_pixels": min_pixels}, "clouds")
    else:
        _refuse({"origin": origin, "min_points": min_points}, "images")
    told = {"sigma": sigma, "prior": prior, "origin": origin, **own}
    options = {name: value for name, value in told.items() if value is not None}
    options["effort"] = chosen.effort
    asked = FindTask(options) if task == "find" else FitTask(options, task)
    folder = None if output is None else Path(output)
    if folder is not None:
        check_output_folder(folder, (JOURNAL,))
    return done_on(
        items,
        asked,
        folder,
        workers=number_of_workers(workers),
        executor=executor,
        is_resumed=resume,
        has_files=files,
    )


def _refuse(given: Mapping[str, Any], what: str) -> None:
    """Raise where an option is given that has no meaning."""
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"{name} must not be given with {what}, got {value!r}")


def done_on(
    items: Sequence[AbstractItem],
    task: AbstractTask,
    output: Path | None,
    *,
    workers: int = 1,
    executor: Executor | None = None,
    is_resumed: bool = False,
    has_files: bool = False,
) -> Generator[Entry]:
    """Do a task on items; the arguments are those of `map_images`."""
    with contextlib.ExitStack() as stack:
        journal, rest = None, items
        if output is not None:
            journal = Journal(output / JOURNAL, is_resumed)
            stack.callback(journal.close)
            if is_resumed:
                done = {
                    one.name
                    for one in items
                    if _is_done(one, task, journal, has_files=has_files)
                }
                yield from journal.entries([*done])
                rest = [one for one in items if one.name not in done]
        work = partial(_done, task, output if has_files else None)
        made: Iterable[list[Entry]]
        if executor is None and workers == 1:
            made = (work([one]) for one in rest)
        else:
            chunks = _chunks(rest)
            running = done_by(work, chunks, executor, workers)
            made = stack.enter_context(contextlib.closing(running))
        for entries in made:
            if journal is not None:
                journal.add(entries)
            yield from entries


def _chunks(items: Sequence[AbstractItem]) -> Iterator[list[AbstractItem]]:
    rest = iter(items)
    while chunk := list(itertools.islice(rest, CHUNK)):
        yield chunk


def _is_done(
    item: AbstractItem, task: AbstractTask, journal: Journal, *, has_files: bool
) -> bool:
    """Whether a journal has an item as it is now."""
    if item.name not in journal:
        return False
    try:
        made_from = _made_from(item, task, has_files=has_files)
        return journal.has(item.name, made_from)
    except (ValueError, OSError):
        return False


def _made_from(item: AbstractItem, task: AbstractTask, *, has_files: bool) -> str:
    """Digest of what the rows of an item, and its files, depend on."""
    # What another version finds may differ.
    told = [item.fingerprint(), task.told(), impostor_jax.__version__, has_files]
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def _done(
    task: AbstractTask, output: Path | None, items: Sequence[AbstractItem]
) -> list[Entry]:
    """What comes of items; their files are written where there is a folder for them."""
    return [_entry(task, output, item) for item in items]


def _entry(task: AbstractTask, output: Path | None, item: AbstractItem) -> Entry:
    try:
        place = None if output is None else output / item.name
        rows = task.done_on(item.read(), place)
        made_from = _made_from(item, task, has_files=output is not None)
    # Whatever is wrong with one image of thousands, the others are done.
    except Exception as error:
        words = " ".join(str(error).split())
        if not isinstance(error, ValueError | OSError):
            words = f"{type(error).__name__}: {words}"
        row = {"image": item.name, "status": FAILED, "reason": words}
        return Entry(item.name, None, [row])
    said = {"version": impostor_jax.__version__}
    rows = [{"image": item.name, **row, **said} for row in rows]
    return Entry(item.name, made_from, rows)
