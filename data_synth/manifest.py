"""The manifest of a dataset: all that its bytes depend on, written before them."""

__all__ = ["Layout", "Manifest"]

import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal, get_args

from data_synth.preset import Preset
from data_synth.sequence import check_can_move
from impostor_jax.arguments import one_of, whole_number
from impostor_jax.io.atomic import write_json
from impostor_jax.io.dataset_manifest import (
    CHECKSUMS,
    MANIFEST,
    MAX_IMAGES,
    MAX_SHARDS,
    SPLIT,
    read_manifest,
    shard_name,
)
from impostor_jax.io.provenance import cpu_model, git_output, package_versions

VERSION = 1

Layout = Literal["bop", "webdataset"]
"""Folders scene by scene, or an archive for each scene."""


@dataclasses.dataclass(frozen=True)
class Manifest:
    """What a dataset is made of.

    Attributes:
        preset: What is drawn.
        name: Of the preset, for a reader.
        count: Number of images.
        seed: Of all that is drawn.
        shard_size: Images of a shard, which is a scene of the format.
        layout: How shards are stored.
        clean: Whether the depth without noise is stored, too.
        normals: Whether normals are stored, too.
        is_sequence: Whether the images of a shard are a video of one scene.
        made_by: Versions of packages, commit and processor, on which the last bits
            depend.
        checksums_sha256: Digest of the list of all files of checksums, which there is
            once no shard is missing; a dataset is the same without.
    """

    preset: Preset
    name: str
    count: int
    seed: int
    shard_size: int
    layout: Layout
    clean: bool
    normals: bool
    is_sequence: bool = False
    made_by: dict[str, Any] = dataclasses.field(default_factory=lambda: made_by())
    checksums_sha256: str | None = dataclasses.field(default=None, compare=False)

    def __post_init__(self) -> None:
        whole_number("count", self.count, 1, MAX_IMAGES)
        whole_number("seed", self.seed, 0, 2**32 - 1)
        whole_number("shard_size", self.shard_size, 1, MAX_SHARDS)
        if self.num_shards > MAX_SHARDS:
            raise ValueError(
                f"count must be at most {MAX_SHARDS} shards of {self.shard_size} "
                f"images, got {self.count}"
            )
        one_of("layout", self.layout, get_args(Layout))
        if self.is_sequence:
            check_can_move(self.preset)

    @property
    def num_shards(self) -> int:
        """Number of shards."""
        return -(-self.count // self.shard_size)

    def images_of(self, shard: int) -> range:
        """Numbers of a shard's images."""
        first = shard * self.shard_size
        return range(first, min(first + self.shard_size, self.count))

    def shard_path(self, folder: Path, shard: int) -> Path:
        """Where a shard is in a dataset."""
        return folder / SPLIT / shard_name(self.layout, shard)

    def checksums_name(self, shard: int) -> str:
        """Name of a shard's checksums in a dataset; none before the shard is whole."""
        return f"{CHECKSUMS}/{shard:06d}.sha256"

    def is_done(self, folder: Path, shard: int) -> bool:
        """Whether a shard is whole."""
        checksums = folder / self.checksums_name(shard)
        return checksums.exists() and self.shard_path(folder, shard).exists()

    def missing(self, folder: Path, shards: Iterable[int]) -> list[int]:
        """Those of some shards that are not whole."""
        return [shard for shard in shards if not self.is_done(folder, shard)]

    def write(self, folder: Path) -> None:
        """Write the manifest of a dataset."""
        fields = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        if self.checksums_sha256 is None:
            del fields["checksums_sha256"]
        if not self.is_sequence:
            del fields["is_sequence"]
        record = {"version": VERSION, **fields, "preset": self.preset.record()}
        write_json(folder / MANIFEST, {**record, "checksums": CHECKSUMS})

    @staticmethod
    def read(folder: Path) -> "Manifest":
        """Read the manifest of a dataset.

        Raises:
            ValueError: There is none, or it is broken or of another version.
        """
        record = read_manifest(folder)
        if record.pop("version", None) != VERSION:
            raise ValueError(f"version of the manifest in {folder} must be {VERSION}")
        record.pop("checksums", None)
        try:
            return Manifest(
                **{**record, "preset": Preset.from_record(record["preset"])}
            )
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"manifest in {folder} is broken: {error}") from error

    def check_same_maker(self) -> None:
        """Raise a `ValueError` where bytes made now might differ from those before."""
        now = made_by()
        differing = [
            f"{name} was {self.made_by.get(name)!r} and is {value!r}"
            for name, value in now.items()
            if self.made_by.get(name) != value
        ]
        if differing:
            raise ValueError(
                "the dataset was begun by another maker, whose bytes may differ: "
                f"{'; '.join(differing)}; allow_other_maker goes on with it"
            )


def made_by() -> dict[str, Any]:
    """Versions, commit and processor of this process."""
    return {
        **package_versions(),
        "commit": git_output("rev-parse", "HEAD"),
        "cpu": cpu_model(),
    }
