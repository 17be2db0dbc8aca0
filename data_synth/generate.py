"""Making datasets: whole ones, parts of them, and the rest of those that were begun."""

__all__ = ["Progress", "generate", "resume"]

import contextlib
import dataclasses
import functools
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from data_synth.appearance import Appearance
from data_synth.catalogue import mesh_ply, models_info
from data_synth.checksums import MODEL_SUMS, damaged, digest_of, listing, seal
from data_synth.images import catalogue_of
from data_synth.manifest import Layout, Manifest
from data_synth.preset import Preset
from data_synth.presets import preset_named
from data_synth.shard import ShardReport, make_shard
from impostor_jax.io.atomic import (
    check_output_folder,
    write_atomically,
    write_json,
    write_text,
)
from impostor_jax.io.dataset_manifest import MANIFEST, SPLIT
from impostor_jax.sensor.base import noise_model
from impostor_jax.workers import done_by, number_of_workers

Progress = Callable[[ShardReport], object]
"""Is called with each shard that is made."""


def generate(
    preset: str | Preset,
    count: int,
    output: str | Path,
    seed: int = 0,
    *,
    sensor: Any = None,
    color: bool = False,
    layout: Layout = "bop",
    shard_size: int = 100,
    sequence: int | None = None,
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
        sensor: Reads depths instead of the preset's, if it is not None.
        color: Whether images in color are written, with the materials and lights of
            `Appearance()` if the preset has none.
        layout: "bop", folders scene by scene; or "webdataset", an archive for each.
        shard_size: Images of a shard, a scene of the format; the unit of work.
        sequence: Images of a video, which is a shard then, of one scene in which the
            camera and things move; None for images of one scene each.
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
    if sensor is not None:
        drawn = dataclasses.replace(drawn, sensor=noise_model(sensor))
    if color and drawn.appearance is None:
        drawn = dataclasses.replace(drawn, appearance=Appearance())
    manifest = Manifest(
        drawn,
        name,
        count,
        seed,
        shard_size if sequence is None else sequence,
        layout,
        clean=clean,
        normals=normals,
        is_sequence=sequence is not None,
    )
    part = _part(manifest, shard, num_shards)
    workers = number_of_workers(workers)
    if not str(output):
        raise ValueError("output must be the path of a folder, got an empty one")
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
    repair: bool = False,
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
        repair: Whether every file is compared with its checksum, and shards of which
            one is missing or has changed are made again.
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
    workers = number_of_workers(workers)
    if repair:
        for number in damaged(path, manifest, part):
            # Without its checksums a shard is not whole.
            (path / manifest.checksums_name(number)).unlink(missing_ok=True)
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
    check_output_folder(folder)
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
    else:
        manifest.write(folder)
    _write_models(folder, manifest)


def _write_models(folder: Path, manifest: Manifest) -> None:
    """Write meshes, for archives where each image is, and the checksums of these."""
    catalogue, _ = catalogue_of(manifest)
    models = folder / "models"
    paths = [models / f"obj_{item.number:06d}.ply" for item in catalogue]
    for path, item in zip(paths, catalogue, strict=True):
        write_text(path, mesh_ply(item))
    paths.append(models / "models_info.json")
    write_json(paths[-1], models_info(catalogue))
    if manifest.layout == "webdataset":
        paths.append(folder / SPLIT / "key_to_shard.json")
        write_atomically(paths[-1], lambda partial: _write_keys(partial, manifest))
    sums = {str(path.relative_to(folder)): digest_of(path) for path in paths}
    write_text(folder / MODEL_SUMS, listing(sums))


def _write_keys(path: Path, manifest: Manifest) -> None:
    """Write which archive each image is in, of many millions without keeping them."""
    with path.open("w") as file:
        mark = "{"
        for shard in range(manifest.num_shards):
            for number in range(len(manifest.images_of(shard))):
                file.write(f'{mark}"{shard:06d}_{number:06d}": {shard}')
                mark = ", "
        file.write("}")


def _run(
    folder: Path,
    manifest: Manifest,
    part: Sequence[int],
    executor: Executor | None,
    workers: int,
    progress: Progress | None,
) -> list[ShardReport]:
    missing = manifest.missing(folder, part)
    for shard in missing:
        _remove_partial(manifest.shard_path(folder, shard))
    reports = []
    if missing:
        work = functools.partial(make_shard, str(folder.resolve()))
        made = done_by(work, missing, executor, min(workers, len(missing)))
        with contextlib.closing(made):
            for report in made:
                reports.append(report)
                if progress is not None:
                    progress(report)
    seal(folder, {MODEL_SUMS, *map(manifest.checksums_name, missing)})
    return reports


def _remove_partial(path: Path) -> None:
    """Remove what processes that were killed left of a shard."""
    for left in path.parent.glob(f".{path.name}.*"):
        shutil.rmtree(left)
