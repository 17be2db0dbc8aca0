"""The command `impostor-synth`."""

__all__ = ["parse"]

import collections
import contextlib
import dataclasses
import json
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from impostor_jax.cli.parse import parse_with
from impostor_jax.io.atomic import check_output_file
from impostor_jax.io.dataset_manifest import MAX_IMAGES, MAX_SHARDS, read_manifest
from impostor_jax.io.json_file import read_json_object
from impostor_jax.plain_arguments import whole_number

if TYPE_CHECKING:
    from data_synth.generate import Progress
    from data_synth.shard import ShardReport


@dataclasses.dataclass(frozen=True)
class Work:
    """Who does the work."""

    workers: int | None = None
    """Number of processes; one a processor if not given."""
    shard: int | None = None
    """Part to make, from 0, of --num-shards equal ones: for job arrays."""
    num_shards: int = 1
    """Number of parts."""
    dask: str | None = None
    """Address of a dask scheduler whose workers share the folder (extra: scale)."""

    @contextlib.contextmanager
    def options(self) -> Iterator[dict[str, Any]]:
        """Arguments of `generate` and `resume`."""
        from impostor_jax.workers import dask_executor

        options = dataclasses.asdict(self)
        address = options.pop("dask")
        if address is None:
            yield options
            return
        tell = partial(print, file=sys.stderr)
        with dask_executor(address, tell) as options["executor"]:
            yield options


@dataclasses.dataclass(frozen=True)
class Generate:
    """Make a dataset.

    Interrupted at any point, `resume` makes the rest. Exits with 2 if an argument is
    bad or the disk is full.
    """

    output: Path
    """Folder, which must be empty or not there."""
    count: int
    """Number of images."""
    preset: str
    """Name of a preset, see `describe`, or a .json file with the record of one."""
    work: Work
    sensor: Path | None = None
    """JSON file of a noise model, as impostor-jax calibrate writes it, which reads
    depths instead of the preset's."""
    color: bool = False
    """Whether to write images in color, too, where the preset does not."""
    seed: int = 0
    """Of all that is drawn."""
    format: Literal["bop", "webdataset"] = "bop"
    """BOP's folders scene by scene, or a BOP-webdataset archive for each scene."""
    shard_size: int = 100
    """Images of a scene, the unit of work."""
    sequence: int | None = None
    """Images of a video, which is a scene then, whose camera and cylinders move."""
    clean: bool = True
    """Whether to write the depth without noise, too."""
    normals: bool = False
    """Whether to write normals, too."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        self._check_given()
        # These start JAX.
        from data_synth.generate import generate
        from impostor_jax.io.sensor_record import read_sensor

        start = time.perf_counter()
        sensor = None if self.sensor is None else read_sensor(self.sensor)
        with self.work.options() as options, _shown(self.count) as progress:
            reports = generate(
                self.preset,
                self.count,
                self.output,
                self.seed,
                sensor=sensor,
                color=self.color,
                layout=self.format,
                shard_size=self.shard_size,
                sequence=self.sequence,
                clean=self.clean,
                normals=self.normals,
                progress=progress,
                **options,
            )
        print(_summary(reports, start, self.output, "nothing was missing"))
        return 0

    def _check_given(self) -> None:
        """Raise where files or flags are seen to be bad without JAX."""
        whole_number("count", self.count, 1, MAX_IMAGES)
        whole_number("shard_size", self.shard_size, 1, MAX_SHARDS)
        if self.sequence is not None:
            whole_number("sequence", self.sequence, 1, MAX_SHARDS)
        _check_preset(self.preset)
        if self.sensor is not None:
            read_json_object(self.sensor, f"sensor file {str(self.sensor)!r}")


@dataclasses.dataclass(frozen=True)
class Resume:
    """Make the shards that a dataset lacks, and those that changed with --repair."""

    folder: tyro.conf.Positional[Path]
    """Of the dataset."""
    work: Work
    allow_other_maker: bool = False
    """Go on even where versions, commit or processor are others than at the beginning,
    so that bytes may differ from those of an uninterrupted run."""
    repair: bool = False
    """Compare every file with its checksum, and make shards again of which one is
    missing or has changed."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        read_manifest(self.folder)
        # These start JAX.
        from data_synth.generate import resume
        from data_synth.manifest import Manifest

        manifest = Manifest.read(self.folder)
        missing = manifest.missing(self.folder, range(manifest.num_shards))
        count = sum(len(manifest.images_of(k)) for k in missing)
        start = time.perf_counter()
        shown = _shown(None if self.repair else count)
        with self.work.options() as options, shown as progress:
            reports = resume(
                self.folder,
                allow_other_maker=self.allow_other_maker,
                repair=self.repair,
                progress=progress,
                **options,
            )
        none = "nothing was missing"
        none += (
            " or changed" if self.repair else "; --repair compares it with checksums"
        )
        print(_summary(reports, start, self.folder, none))
        return 0


@dataclasses.dataclass(frozen=True)
class Describe:
    """Say what a preset draws, or which presets there are."""

    preset: tyro.conf.Positional[str | None] = None
    """Name or .json file; all presets, with their sentences, if not given."""
    json: bool = False
    """Print the record of the preset, which `generate --preset FILE.json` takes."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        if self.preset is not None:
            _check_preset(self.preset)
        # These start JAX.
        from data_synth.describe import describe
        from data_synth.presets import PRESETS, preset_named

        if self.preset is None:
            for name, preset in PRESETS.items():
                print(f"{name}: {preset.sentence}")
            return 0
        preset = preset_named(self.preset)
        print(json.dumps(preset.record(), indent=2) if self.json else describe(preset))
        return 0


@dataclasses.dataclass(frozen=True)
class Validate:
    """Check that a dataset is whole and unchanged, and that its labels fit its images.

    Exits with 1 and a line for each problem if it is not.
    """

    folder: tyro.conf.Positional[Path]
    """Of the dataset."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        read_manifest(self.folder)
        # These start JAX.
        from data_synth.manifest import Manifest
        from data_synth.validate import validate

        problems = validate(self.folder)
        manifest = Manifest.read(self.folder)
        print("\n".join(problems) or f"{manifest.count} images are good")
        return 1 if problems else 0


@dataclasses.dataclass(frozen=True)
class Preview:
    """Draw a contact sheet of a dataset's first images."""

    folder: tyro.conf.Positional[Path]
    """Of the dataset."""
    output: Path = Path("preview.png")
    """File to write."""
    count: int = 12
    """Most images on it."""

    def run(self) -> int:
        """Run the command; returns the exit code."""
        whole_number("count", self.count, 1)
        if not self.folder.is_file():
            read_manifest(self.folder)
        check_output_file(self.output)
        # This starts JAX.
        from data_synth.preview import preview

        preview(self.folder, self.output, self.count)
        print(self.output)
        return 0


Command = (
    Annotated[Generate, tyro.conf.subcommand("generate")]
    | Annotated[Resume, tyro.conf.subcommand("resume")]
    | Annotated[Describe, tyro.conf.subcommand("describe")]
    | Annotated[Validate, tyro.conf.subcommand("validate")]
    | Annotated[Preview, tyro.conf.subcommand("preview")]
)


def parse(arguments: Sequence[str]) -> Command:
    """Parse the arguments; a mistake ends the program with one line and exit code 2."""
    description = "Make labeled depth images of cylinders."
    return parse_with(Command, "impostor-synth", description, arguments)


def _check_preset(name: str) -> None:
    """Raise where a preset's file is not readable, which is seen without JAX."""
    if name.endswith(".json"):
        read_json_object(Path(name), f"preset {name!r}")


@contextlib.contextmanager
def _shown(count: int | None) -> Iterator["Progress"]:
    """What shows progress on stderr, with the time left; quiet in a pipe.

    Of what ends the work early it says that it can go on.
    """
    from tqdm import tqdm

    rest = "resume makes what is missing"
    try:
        with tqdm(total=count, unit="image", disable=None, file=sys.stderr) as bar:
            yield lambda report: bar.update(report.num_images)
    except BrokenExecutor as error:
        raise OSError(f"a worker process was killed; {rest}") from error
    except KeyboardInterrupt as interrupt:
        raise KeyboardInterrupt(f"interrupted; {rest}") from interrupt


def _summary(
    reports: list["ShardReport"], start: float, folder: Path, none: str
) -> str:
    """What was made, what the time went into, and what was rejected; or `none`."""
    seconds = time.perf_counter() - start
    count = sum(report.num_images for report in reports)
    if not count:
        return f"{folder}: {none}"
    spent: collections.Counter[str] = collections.Counter()
    rejected: collections.Counter[str] = collections.Counter()
    for report in reports:
        spent.update(report.seconds)
        rejected.update(report.rejected)
    stages = ", ".join(f"{name} {1e3 * s / count:.1f}" for name, s in spent.items())
    lines = [
        f"{folder}: {count} images in {seconds:.1f} s, {count / seconds:.1f} images/s",
        f"  ms of a process for an image: {stages}",
    ]
    if rejected:
        rules = ", ".join(f"{rule} {n}" for rule, n in sorted(rejected.items()))
        lines.append(f"  scenes rejected: {rules}")
    return "\n".join(lines)
