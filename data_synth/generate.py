"""Making datasets: whole ones, parts of them, and the rest of those that were begun."""

__all__ = ["Progress", "generate", "resume"]

import concurrent.futures
import json
import multiprocessing
import multiprocessing.connection
import os
import shutil
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path

from data_synth.catalogue import mesh_ply, models_info
from data_synth.images import catalogue_of
from data_synth.manifest import Layout, Manifest
from data_synth.preset import Preset
from data_synth.presets import preset_named
from data_synth.shard import ShardReport, make_shard
from impostor_jax.io.atomic import write_json, write_text
from impostor_jax.io.dataset import MANIFEST, SPLIT

Progress = Callable[[ShardReport], None]
"""Is called with each shard that is made."""


def generate(
    preset: str | Preset,
    count: int,
    output: str | Path,
    seed: int = 0,
    *,
    layout: Layout = "bop",
    shard_size: int = 100,
    clean: bool = True,
    normals: bool = False,
    executor: Executor | None = None,
    workers: int | None = None,
    shard: int | None = None,
    num_shards: int = 1,
    progress: Progress | None = None,
) -> list[ShardReport]:
    """Make a dataset.

    The bytes depend on the arguments up to `normals`, and, in their last bits, on the
    versions of packages and the processor; not on executor, workers, order or parts.

    Args:
        preset: A preset, the name of one, or of a JSON file that holds its record.
        count: Number of images.
        output: Folder, which must be empty or not there.
        seed: Of all that is drawn.
        layout: "bop", folders scene by scene; or "webdataset", an archive for each.
        shard_size: Images of a shard, a scene of the format; the unit of work.
        clean: Whether the depth without noise is written, too.
        normals: Whether normals are written, too.
        executor: What runs the work, such as `dask.distributed.Client.get_executor()`;
            a pool of processes if None.
        workers: Number of processes of that pool; one a processor if None.
        shard: Which part of the dataset to make, from 0, of `num_shards` equal ones
            that share a folder: for job arrays. All of it if None.
        num_shards: Number of parts.
        progress: Is called with each shard that is made.

    Returns:
        What was made, in the order in which it was ready.

    Raises:
        ValueError: An argument is out of range, or the folder holds something else; or
            the rules of the preset reject all scenes.
        OSError: The disk is full; no half shard is left.
    """
    name = preset if isinstance(preset, str) else "custom"
    drawn = preset_named(preset) if isinstance(preset, str) else preset
    manifest = Manifest(
        drawn, name, count, seed, shard_size, layout, clean=clean, normals=normals
    )
    part = _part(manifest, shard, num_shards)
    folder = Path(output)
    _prepare(folder, manifest, is_shared=shard is not None)
    return _run(folder, manifest, part, executor, workers, progress)


def resume(
    folder: str | Path,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    shard: int | None = None,
    num_shards: int = 1,
    allow_other_maker: bool = False,
    progress: Progress | None = None,
) -> list[ShardReport]:
    """Make the shards that a dataset lacks.

    No other process may be at work in the folder, but those of the other parts.

    Args:
        folder: Of the dataset.
        executor: As in `generate`.
        workers: As in `generate`.
        shard: As in `generate`.
        num_shards: As in `generate`.
        allow_other_maker: Whether to go on where versions, commit or processor are not
            those of the manifest, so that bytes may differ from an uninterrupted run's.
        progress: As in `generate`.

    Returns:
        What was made.

    Raises:
        ValueError: The folder has no manifest, or its maker was another.
        OSError: The disk is full; no half shard is left.
    """
    path = Path(folder)
    manifest = Manifest.read(path)
    if not allow_other_maker:
        manifest.check_same_maker()
    part = _part(manifest, shard, num_shards)
    _write_models(path, manifest)
    return _run(path, manifest, part, executor, workers, progress)


def _part(manifest: Manifest, shard: int | None, num_shards: int) -> range:
    """Numbers of the shards of one of several parts."""
    if num_shards < 1:
        raise ValueError(f"num_shards must be at least 1, got {num_shards}")
    if shard is None:
        if num_shards > 1:
            raise ValueError(f"shard must be given where num_shards is {num_shards}")
        return range(manifest.num_shards)
    if not 0 <= shard < num_shards:
        raise ValueError(
            f"shard must be from 0 to {num_shards - 1}, num_shards less 1; got {shard}"
        )
    return range(shard, manifest.num_shards, num_shards)


def _prepare(folder: Path, manifest: Manifest, *, is_shared: bool) -> None:
    """Write what comes before the first image.

    Raises:
        ValueError: The folder holds something else.
    """
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"output must be a folder, got the file {str(folder)!r}")
    # Before the manifest is looked for, since another part may be writing it.
    names = [path.name for path in folder.iterdir()] if folder.exists() else []
    if (folder / MANIFEST).exists():
        if not is_shared or Manifest.read(folder) != manifest:
            raise ValueError(
                f"output must be an empty folder, but {str(folder)!r} holds a dataset; "
                "go on with it by resume"
            )
    elif any(not name.startswith(f".{MANIFEST}.") for name in names):
        raise ValueError(f"output must be an empty folder, but {str(folder)!r} is not")
    manifest.write(folder)
    _write_models(folder, manifest)


def _write_models(folder: Path, manifest: Manifest) -> None:
    """Write meshes, and for archives where each image is."""
    catalogue, _ = catalogue_of(manifest)
    models = folder / "models"
    for item in catalogue:
        write_text(models / f"obj_{item.number:06d}.ply", mesh_ply(item))
    write_json(models / "models_info.json", models_info(catalogue))
    if manifest.layout == "webdataset":
        shards = range(manifest.num_shards)
        keys = {
            f"{shard:06d}_{number:06d}": shard
            for shard in shards
            for number in range(len(manifest.images_of(shard)))
        }
        write_text(folder / SPLIT / "key_to_shard.json", json.dumps(keys))


def _run(
    folder: Path,
    manifest: Manifest,
    part: Sequence[int],
    executor: Executor | None,
    workers: int | None,
    progress: Progress | None,
) -> list[ShardReport]:
    missing = manifest.missing(folder, part)
    for shard in missing:
        _remove_partial(manifest.shard_path(folder, shard))
    if workers is None:
        workers = len(os.sched_getaffinity(0))
    if workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    if not missing:
        return []
    reports, own = [], None
    if executor is None:
        workers = min(workers, len(missing))
        own = executor = ProcessPoolExecutor(
            workers,
            multiprocessing.get_context("spawn"),
            initializer=_begin_worker,
            initargs=(max(1, len(os.sched_getaffinity(0)) // workers),),
        )
    # All at once: a shard of 100 images each, a million are ten thousand.
    futures = [
        executor.submit(make_shard, str(folder.resolve()), shard) for shard in missing
    ]
    try:
        for future in concurrent.futures.as_completed(futures):
            reports.append(future.result())
            if progress is not None:
                progress(reports[-1])
    finally:
        for future in futures:
            future.cancel()
        if own is not None:
            own.shutdown()
    return reports


def _remove_partial(path: Path) -> None:
    """Remove what processes that were killed left of a shard."""
    for left in path.parent.glob(f".{path.name}.*"):
        shutil.rmtree(left)


def _begin_worker(threads: int) -> None:
    """Let only the parent end this process, and let it end with the parent.

    An interrupt from the keyboard reaches all processes: workers finish their shards.
    Without the thread they would wait for work for ever after a parent that was killed.

    Args:
        threads: Of XLA. If each process had one for every processor, they would wait
            for each other's: an image would take a fifth longer.
    """
    # Read when the first array is made, which the import of JAX does not do.
    os.environ.setdefault("PJRT_NPROC", str(threads))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
