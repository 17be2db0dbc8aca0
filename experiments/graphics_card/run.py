"""Time draws and fits on a graphics card and on the processor beside it."""

__all__ = ["Config", "measure"]

import dataclasses
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import impostor_jax as ij
from experiments.fit_speed.cases import fit_one, see_can
from experiments.graphics_card.report import tables
from experiments.recording import Metric
from experiments.render_speed.cases import OUTPUTS, larger_can_loss, make_many
from experiments.running import RunConfig, main
from experiments.scenes import SIGMA, make_can, make_view, with_noise
from experiments.timing import sample, time_in_turns
from impostor_jax.device import Device
from impostor_jax.numerics import eps
from impostor_jax.parity.traced_cases import traced

Call = Callable[[], object]

MOST = 64
"""Shapes whose gradients the processor is timed with: more take minutes."""

DIFFERENT = 64
"""Images that differ, of those of one call."""


@dataclasses.dataclass(frozen=True)
class Config:
    """The same calls on a graphics card and on the processor."""

    run: RunConfig = RunConfig()
    repeats: int = 20
    """Timed calls of a case."""
    width: int = 640
    """Of an image, in pixels; 4/3 of its height."""
    batches: tuple[int, ...] = (64, 1024)
    """Shapes, or images, of one call."""
    scenes: tuple[int, ...] = (100, 1000, 10000)
    """Cylinders of a scene."""


@dataclasses.dataclass(frozen=True)
class Case:
    """What is timed.

    Attributes:
        make: Its arguments are made, and what it calls is compiled, on the device.
        on_both: Whether the processor is timed, too.
    """

    make: Callable[[], Call]
    on_both: bool = True


def measure(config: Config) -> Iterator[Metric]:
    """Errors, then times, case by case."""
    card, processor = jax.devices()[0], jax.devices("cpu")[0]
    if card.platform == "cpu" and not config.run.quick:
        raise ValueError("a graphics card that JAX works with is needed, got none")
    view = make_view(config.width, config.width * 3 // 4)
    yield from _errors(view, card)
    for name, case in _cases(config, view).items():
        for label, device in (("card", card), ("processor", processor)):
            if device is card or case.on_both:
                with jax.default_device(device):
                    yield from _timed(f"{name}.{label}", case.make(), config.repeats)


def _timed(name: str, call: Call, repeats: int) -> Iterator[Metric]:
    start = time.perf_counter()
    jax.block_until_ready(call())
    first = time.perf_counter() - start
    yield Metric(f"{name}.first", first, None, "s", "lower", 1)
    timing = time_in_turns({name: call}, repeats, warm_up=1)[name]
    yield sample(f"{name}.time", timing.ms, "ms")


def _errors(view: ij.PinholeCamera, card: Device) -> Iterator[Metric]:
    """Differences between single precision on the card and double on the processor."""
    can = make_can()
    with jax.default_device(card):
        drawn = ij.render(can, view)
    with jax.default_device(jax.devices("cpu")[0]):
        exact = ij.render(can, view, effort=ij.Effort(precision="float64"))
    maps = [
        tuple(np.asarray(getattr(each, name), float) for name in ("depth", "normal"))
        for each in (drawn, exact)
    ]
    (depth, normal), (true, true_normal) = maps
    seen = np.isfinite(depth) & np.isfinite(true)
    apart = np.isfinite(depth) != np.isfinite(true)
    yield Metric("error.mask", int(apart.sum()), None, "pixels", "lower", apart.size)
    errors = {
        "depth": depth[seen] / true[seen] - 1,
        "normal": normal[seen] - true_normal[seen],
    }
    for name, error in errors.items():
        worst = float(np.abs(error).max() / eps("float32"))
        yield Metric(f"error.{name}", worst, None, "eps", "lower", len(error))


def _cases(config: Config, view: ij.PinholeCamera) -> dict[str, Case]:
    cases = {
        "depth, normal and mask of a can": Case(partial(_drawn, view)),
        "loss and gradient of a can": Case(partial(_gradients, view, 1)),
    }
    for count in config.batches:
        cases[f"loss and gradient of {count} cans"] = Case(
            partial(_gradients, view, count), count <= MOST
        )
    for count in config.scenes:
        cases[f"{count} cylinders"] = Case(partial(_scene, view, count))
    cases["traced scene"] = Case(partial(_traced, view))
    cases["fit of a can"] = Case(partial(_fit, view))
    if not config.run.quick:
        for count in config.batches:
            # A processor takes one after the other.
            cases[f"fits of {count} cans"] = Case(partial(_fits, view, count), False)
        cases["a video's image with three cans"] = Case(partial(_track, view))
    return cases


def _drawn(view: ij.PinholeCamera) -> Call:
    return lambda: ij.render(make_can(), view)


def _gradients(view: ij.PinholeCamera, count: int) -> Call:
    """Squared difference to the depth of a larger can, and its derivatives."""
    compiled = jax.jit(jax.vmap(jax.value_and_grad(larger_can_loss(view))))
    return partial(compiled, _several(make_can(), count))


def _several(tree: Any, count: int) -> Any:
    """So many of the same."""
    return jax.tree.map(lambda x: jnp.stack([jnp.asarray(x)] * count), tree)


def _scene(view: ij.PinholeCamera, count: int) -> Call:
    scene = ij.Scene([make_many(count, 0)])
    return lambda: ij.render(scene, view, OUTPUTS)


def _traced(view: ij.PinholeCamera) -> Call:
    case = traced("perspective")[0]
    scene, (lights, materials) = ij.Scene(case.shapes), (case.lights, case.materials)
    return lambda: ij.trace(scene, view, list(lights), list(materials))


def _fit(view: ij.PinholeCamera) -> Call:
    seen = see_can(view.width / 640, 1)
    return partial(fit_one, seen)


def _fits(view: ij.PinholeCamera, count: int) -> Call:
    """Fits in one `vmap`, as `fit_cylinders` says, each from the true can."""
    seen = see_can(view.width / 640, DIFFERENT)
    depths = jnp.stack([seen.depths[k % DIFFERENT] for k in range(count)])
    mask = jnp.asarray(seen.mask)

    def fit(depth: Float[Array, "h w"], can: ij.Cylinder) -> ij.Fit:
        return ij.fit_cylinder(depth, view, mask, SIGMA, initial=can)

    return partial(jax.jit(jax.vmap(fit)), depths, _several(seen.can, count))


def _track(view: ij.PinholeCamera) -> Call:
    cans = [
        ij.Cylinder((x, 0.02, 0.8 + 0.05 * x), (0.2, 0.9, 0.3), 0.03 + 0.01 * x, 0.1)
        for x in (-0.2, 0.0, 0.2)
    ]
    maps = ij.render(ij.Scene(cans), view, ("depth",))
    depth = with_noise(np.asarray(maps.depth), SIGMA, np.random.default_rng(0))
    tracker = ij.Tracker(view, sigma=SIGMA)
    for _ in range(3):
        tracker.step(depth)
    return lambda: [track.cylinder for track in tracker.step(depth)]


if __name__ == "__main__":
    trial = Config(repeats=2, width=160, batches=(2,), scenes=(4,))
    main(Config, measure, tables, trial)
