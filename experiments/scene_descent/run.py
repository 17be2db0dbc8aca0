"""Recover a scene from one depth image by gradients, from random starts."""

__all__ = ["Config", "measure"]

import dataclasses
import time
from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax

import impostor_jax as ij
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.scene_descent.report import LEVELS, tables
from experiments.scene_descent.scenes import (
    CAMERA,
    PARTS,
    RADIUS,
    errors,
    scene_of,
    start,
    truth,
)
from experiments.timing import sample

NOISE = 0.001
"""Of the image, in meters."""

WIDTH = 0.005
"""What the loss takes for the noise: it pulls from farther away."""

GAP = 0.1
"""What counts where only one sees something, in meters."""

OUTLINE = ("outlines", True, 0.04)
DEPTH = ("depth", False, 0.04)
END = ("depth", False, 0.01)
"""A stage: its name, whether outlines count, and the first step, in radii."""

WAYS = {"depth": (DEPTH, END), "outlines": (OUTLINE, END)}
"""Stages one after the other."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure how often gradients recover a scene."""

    run: RunConfig = RunConfig()
    starts: int = 100
    """Random ones."""
    steps: int = 120
    """Of Adam, of each of two stages."""
    seed: int = 0
    """Of the image's noise and of the starts."""


def measure(config: Config) -> Iterator[Metric]:
    """Share of starts that come home, and how far off they are, for each way."""
    rng = np.random.default_rng(config.seed)
    seen = np.asarray(ij.render(scene_of(truth()), CAMERA, ("depth",)).depth)
    image = jnp.asarray(seen + rng.normal(0, NOISE, seen.shape), seen.dtype)
    begun = [start(rng) for _ in range(config.starts)]
    stages = {
        stage: _stage(stage, config.steps, image) for stage in (OUTLINE, DEPTH, END)
    }
    ends: dict[str, list[dict[str, Any]]] = {"start": [errors(one) for one in begun]}
    for way, parts in WAYS.items():
        ends[way], seconds = [], []
        for values in begun:
            before = time.perf_counter()
            for stage in parts:
                values = stages[stage](values)
            ends[way].append(errors(jax.block_until_ready(values)))
            seconds.append(time.perf_counter() - before)
        yield sample(f"{way}.time", seconds, "s")
    for way, found in ends.items():
        worst = np.array([max(one.values()) for one in found])
        for level in LEVELS:
            share = float(np.mean(worst < level))
            yield Metric.share(f"{way}.within_{level}", share, len(found))
        for name in PARTS:
            off = [one[name] for one in found]
            unit = "rad" if name in ("axis", "box turn") else "radii"
            yield sample(f"{way}.{name.replace(' ', '_')}", off, unit)


def _stage(
    stage: tuple[str, bool, float], steps: int, image: Any
) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Adam, from some values, on a loss with outlines or without."""
    _, outline, first = stage
    outputs = ("depth", "share", "beside") if outline else ("depth",)
    optimizer = optax.adam(optax.cosine_decay_schedule(first, steps, 0.02))

    @jax.jit
    def step(moved: Any, state: Any, begun: Any) -> Any:
        def loss(moved: Any) -> Any:
            maps = ij.render(scene_of(_moved(begun, moved)), CAMERA, outputs)
            return ij.depth_loss(maps, image, sigma=WIDTH, outline=outline, gap=GAP)

        slope = jax.grad(loss)(moved)
        # Optax takes powers of fractions by whole numbers.
        with jax.numpy_dtype_promotion("standard"):
            updates, state = optimizer.update(slope, state)
        return optax.apply_updates(moved, updates), state

    def descend(begun: dict[str, Any]) -> dict[str, Any]:
        moved = jax.tree.map(jnp.zeros_like, begun)
        state = optimizer.init(moved)
        for _ in range(steps):
            moved, state = step(moved, state, begun)
        return _moved(begun, moved)

    return descend


def _moved(begun: dict[str, Any], moved: dict[str, Any]) -> dict[str, Any]:
    """Values that have moved by so many radii."""
    return jax.tree.map(lambda value, by: value + RADIUS * by, begun, moved)


if __name__ == "__main__":
    main(Config, measure, tables, Config(starts=1, steps=2))
