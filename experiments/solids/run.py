"""Cast rays at random solids, compare them with an oracle, and time a render."""

__all__ = ["Config", "measure"]

import dataclasses
import time
from collections.abc import Iterator

import jax
import numpy as np

import impostor_jax as ij
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.scenes import CAMERA
from experiments.solids.judged import judge, rays_at
from experiments.solids.report import DISTANCES, tables
from experiments.solids.trees import KINDS, drawn, jax_solid, random_tree
from experiments.timing import sample, time_in_turns

MOST_SHAPES = 8

AXIS = (0.3, -0.8, -0.52)
"""Of the can that is timed."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure how often rays see something wrong of solids, and what they cost."""

    run: RunConfig = RunConfig()
    trees: int = 100
    """Random expressions."""
    each: int = 10
    """Random shapes for each of them."""
    rays: int = 1000
    """At each solid, from each distance."""
    repeats: int = 60
    """Of each timed call."""
    seed: int = 0
    """Of all draws."""


def measure(config: Config) -> Iterator[Metric]:
    """Compare, then time."""
    yield from _compared(config)
    yield from _timed(config.repeats)


def _compared(config: Config) -> Iterator[Metric]:
    rng = np.random.default_rng(config.seed)
    names = ("hits", "differs", "is_wrong", "is_nan")
    counts = {distance: dict.fromkeys(names, 0) for distance in DISTANCES}
    for _ in range(config.trees):
        count = int(rng.integers(1, MOST_SHAPES + 1))
        tree = random_tree(rng, count)
        kinds = [str(kind) for kind in rng.choice(KINDS, count)]
        for _ in range(config.each):
            shapes = drawn(rng, tree, kinds)
            solid = jax_solid(shapes)
            for distance, count_of in counts.items():
                pose, origin, direction = rays_at(rng, distance, config.rays)
                found = judge(shapes, solid.transformed(pose), origin, direction, rng)
                count_of["hits"] += int(found.hits.sum())
                count_of["differs"] += int(found.differs.sum())
                count_of["is_wrong"] += int(found.is_wrong.sum())
                count_of["is_nan"] += int((~found.is_finite).sum())
    n = config.trees * config.each * config.rays
    for distance, count_of in counts.items():
        for name, number in count_of.items():
            key = f"rays.{distance:g}.{name}"
            better = "higher" if name == "hits" else "lower"
            yield Metric.share(key, number / n, n, better)


def _timed(repeats: int) -> Iterator[Metric]:
    """A can and solids made of it, small in the image and all over it."""
    for view, distance in (("small", 0.8), ("close", 0.16)):
        shapes = _shapes(distance)
        calls = {
            name: lambda shape=shape: ij.render(shape, CAMERA)
            for name, shape in shapes.items()
        }
        for name, call in calls.items():
            start = time.perf_counter()
            jax.block_until_ready(call())
            first = time.perf_counter() - start
            if view == "small":
                yield Metric(f"first.{name}", first, None, "s", "lower", 1)
        for name, timing in time_in_turns(calls, repeats).items():
            yield sample(f"time.{view}.{name}", timing.ms.ravel(), "ms")


def _shapes(z: float) -> dict[str, ij.AbstractPrimitive]:
    """Solids by how many shapes they are made of; the can alone, too."""

    def can(radius: float, height: float = 0.12) -> ij.Cylinder:
        return ij.Cylinder((0, 0, z), AXIS, radius, height)

    handle = ij.Cylinder((0.02, 0, z), (1, 0, 0), 0.01, 0.1)
    knob = ij.Sphere((0, 0.05, z), 0.03)
    slot = ij.Box((0, 0, z - 0.05), np.eye(3), (0.02, 0.02, 0.1))
    five = (can(0.04) | handle | knob) - can(0.03) - slot
    flange = ij.Cylinder((0, 0.03, z), AXIS, 0.05, 0.01)
    dent = ij.Sphere((0.04, 0, z - 0.03), 0.02)
    hole = ij.Cylinder((0, 0, z), (0, 0, 1), 0.005, 0.5)
    return {
        "can": can(0.04),
        "1": ij.union(can(0.04)),
        "2": can(0.04) - can(0.03),
        "5": five,
        "8": (five | flange) - dent - hole,
    }


if __name__ == "__main__":
    main(Config, measure, tables, Config(trees=1, each=1, rays=100, repeats=2))
