"""Checksums of a dataset: of every file, and of the files of checksums themselves.

Each shard has a file of checksums, written when it is whole; `models.sha256` is of what
all shards share. Once no shard is missing, `checksums.sha256` lists the digests of
these files, and the manifest keeps its digest. So nothing but the manifest can change
without being found, many processes write at once, and the bytes are the same whoever
ends last. All of them are as `sha256sum --check checksums/*` reads them.
"""

__all__ = [
    "MODEL_SUMS",
    "damaged",
    "digest_of",
    "listing",
    "problems_of_list",
    "problems_of_models",
    "problems_of_shard",
    "seal",
    "trusted_list",
]

import dataclasses
import hashlib
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path

from data_synth.manifest import Manifest
from impostor_jax.io.atomic import write_text
from impostor_jax.io.dataset_manifest import CHECKSUMS, SPLIT
from impostor_jax.io.input_file import sha256_of

MODEL_SUMS = f"{CHECKSUMS}/models.sha256"
"""Of the meshes, and for archives of where each image is."""

LIST = f"{CHECKSUMS}/checksums.sha256"
"""Of the other files of checksums."""


def listing(sums: Mapping[str, str]) -> str:
    """The text of a file of checksums, of digests by the names of files."""
    return "".join(f"{digest}  {name}\n" for name, digest in sorted(sums.items()))


def _read(path: Path) -> dict[str, str]:
    """Digests by the names of files; none where there is no such file."""
    if not path.is_file():
        return {}
    lines = path.read_bytes().decode(errors="replace").splitlines()
    return {name: digest for digest, _, name in (x.partition("  ") for x in lines)}


def digest_of(path: Path) -> str:
    """Digest of a file; empty where there is none."""
    return sha256_of(path) if path.is_file() else ""


def _digest_of_text(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _names(manifest: Manifest) -> list[str]:
    """All files of checksums of a whole dataset, but their list."""
    return [MODEL_SUMS, *map(manifest.checksums_name, range(manifest.num_shards))]


def trusted_list(folder: Path, manifest: Manifest) -> dict[str, str] | None:
    """Digests of the files of checksums, as they were when the dataset was whole.

    None where it never was, or where the list has changed and cannot be made again,
    since one of the files has, too.
    """
    if manifest.checksums_sha256 is None:
        return None
    if digest_of(folder / LIST) == manifest.checksums_sha256:
        return _read(folder / LIST)
    sums = {name: digest_of(folder / name) for name in _names(manifest)}
    is_same = _digest_of_text(listing(sums)) == manifest.checksums_sha256
    return sums if is_same else None


def seal(folder: Path, written: Collection[str]) -> None:
    """List the files of checksums, with a digest in the manifest; if all are there.

    What was listed before and is not `written` now keeps its digest, so that a file
    that was altered stays one that was.

    Args:
        folder: Of the dataset.
        written: Names of files of checksums that are known to be good.
    """
    # Another part may have written it since this one began.
    manifest = Manifest.read(folder)
    if manifest.missing(folder, range(manifest.num_shards)):
        return
    names = _names(manifest)
    trusted = trusted_list(folder, manifest)
    kept = {name: x for name, x in (trusted or {}).items() if name not in written}
    sums = {name: kept.get(name) or digest_of(folder / name) for name in names}
    text = listing(sums)
    digest = _digest_of_text(text)
    differs = manifest.checksums_sha256 not in (None, digest)
    if differs and trusted is None and not set(names) <= set(written):
        # One of them has changed, and nobody knows which.
        return
    write_text(folder / LIST, text)
    dataclasses.replace(manifest, checksums_sha256=digest).write(folder)


def damaged(folder: Path, manifest: Manifest, shards: Iterable[int]) -> list[int]:
    """Those of some shards of which a file is missing or has changed.

    All of them, where the files of checksums cannot be trusted.
    """
    trusted = trusted_list(folder, manifest)
    if trusted is None and manifest.checksums_sha256 is not None:
        return list(shards)

    def is_damaged(shard: int) -> bool:
        if not manifest.is_done(folder, shard):
            return True
        if trusted is None:
            # Its checksums may have been emptied, which only its other files tell.
            return any(problems_of_shard(folder, manifest, shard, None))
        return any(_problems(folder, manifest.checksums_name(shard), trusted))

    return [shard for shard in shards if is_damaged(shard)]


def problems_of_list(folder: Path, manifest: Manifest) -> Iterator[str]:
    """What is wrong with the list of the files of checksums."""
    if manifest.checksums_sha256 is None:
        if not manifest.missing(folder, range(manifest.num_shards)):
            yield "the manifest has no digest of the checksums; resume adds it"
        return
    yield from _change(folder, LIST, manifest.checksums_sha256)


def problems_of_models(
    folder: Path, manifest: Manifest, trusted: Mapping[str, str] | None
) -> Iterator[str]:
    """What is wrong with the files that all shards share."""
    yield from _problems(folder, MODEL_SUMS, trusted)
    sums = _read(folder / MODEL_SUMS)
    top = {manifest.shard_path(folder, k).name for k in range(manifest.num_shards)}
    found = [p for p in (folder / "models").rglob("*") if p.is_file()]
    found += [p for p in _entries(folder / SPLIT) if p.name not in top]
    yield from _unlisted(folder, found, sums)


def problems_of_shard(
    folder: Path, manifest: Manifest, shard: int, trusted: Mapping[str, str] | None
) -> Iterator[str]:
    """What is wrong with the files of a shard that is there."""
    name, path = manifest.checksums_name(shard), manifest.shard_path(folder, shard)
    yield from _problems(folder, name, trusted)
    found = [p for p in path.rglob("*") if p.is_file()]
    yield from _unlisted(folder, found or [path], _read(folder / name))


def _entries(folder: Path) -> list[Path]:
    """What is in a folder, but for what is not whole yet."""
    if not folder.is_dir():
        return []
    return [path for path in folder.iterdir() if not path.name.startswith(".")]


def _problems(
    folder: Path, name: str, trusted: Mapping[str, str] | None
) -> Iterator[str]:
    """Files that are not as a file of checksums says, or that file itself."""
    yield from _change(folder, name, None if trusted is None else trusted.get(name, ""))
    for listed, digest in _read(folder / name).items():
        yield from _change(folder, listed, digest)


def _change(folder: Path, name: str, digest: str | None) -> Iterator[str]:
    """Whether a file is missing, or is not that of a digest; None for any."""
    found = digest_of(folder / name)
    if not found:
        yield f"{name} is missing"
    elif digest is not None and found != digest:
        yield f"{name} has changed since it was written"


def _unlisted(
    folder: Path, found: list[Path], sums: Mapping[str, str]
) -> Iterator[str]:
    """Files that are in no file of checksums."""
    names = sorted(str(path.relative_to(folder)) for path in found)
    yield from (f"{name} is in no checksum file" for name in names if name not in sums)
