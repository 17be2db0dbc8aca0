"""A preset of small images, and datasets of it that tests share."""

from concurrent.futures import Executor, Future
from pathlib import Path

import impostor_jax as ij
from data_synth.camera_draw import CameraDraw
from data_synth.distribution import Fixed, Uniform, Whole
from data_synth.generate import generate
from data_synth.preset import Preset, Rules

WIDTH, HEIGHT = 64, 48
COUNT, SHARD_SIZE, SEED = 10, 4, 7

SMALL = Preset(
    sentence="One or two cans on a table before a wall.",
    objects=5,
    count=Whole(1, 2),
    clutter=Whole(0, 1),
    radius=Uniform(0.04, 0.06),
    aspect=Uniform(2.0, 4.0),
    placement=("standing", "lying"),
    distance=Uniform(0.7, 0.9),
    spread=0.15,
    ground=True,
    wall=Fixed(2.0),
    camera=CameraDraw(count=2, width=WIDTH, height=HEIGHT, focal=Uniform(50.0, 56.0)),
    sensor=ij.Dropout(ij.FlyingPixels(ij.StructuredLight())),
    projector_baseline=0.075,
    rules=Rules(visible_fraction=0.2, smallest_outline=30),
)


class Here(Executor):
    """Runs everything at once in this process, which has the program compiled."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except BaseException as error:
            future.set_exception(error)
        return future


def small_dataset(folder: Path, preset: Preset = SMALL, **options):
    """Make a small dataset in this process."""
    options = {"count": COUNT, "seed": SEED, "shard_size": SHARD_SIZE, **options}
    return generate(preset, output=folder, executor=Here(), **options)


def checksums(folder: Path) -> dict[str, str]:
    """Checksums of all shards, by file."""
    files = sorted((folder / "checksums").iterdir())
    lines = [line for file in files for line in file.read_text().splitlines()]
    return {line[66:]: line[:64] for line in lines}
