"""How the time of a call grows with the work: pixels, cylinders, batch, parameters."""

__all__ = ["CURVES", "measure_scaling"]

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

import impostor_jax as ij
from experiments.recording import Metric
from experiments.render_speed.cases import (
    OUTPUTS,
    larger_can_loss,
    make_many,
    squared_difference,
)
from experiments.render_speed.kernel import Kernel
from experiments.render_speed.workloads import Calls
from experiments.scenes import make_can, make_view
from experiments.timing import growth, sample, time_in_turns

SEED = 2

UPPER = 3
"""Largest sizes of a curve, to which its exponent is fitted."""

COARSE = 4
"""How many times coarser the pixels of a batch's images are than the others'."""

PER_CYLINDER = 8
"""Parameters: center, axis, radius and height."""


class Curve(NamedTuple):
    """One kind of work that grows.

    Attributes:
        calls: The programs, by name, that do the work of a size.
        sizes: From small to large.
        trial: Sizes of a quick run.
        amount: What the axis of the curve counts, of a size.
        share: Of the run's repeats.
    """

    calls: Callable[[int, ij.PinholeCamera, Kernel | None], Calls]
    sizes: tuple[int, ...]
    trial: tuple[int, ...]
    amount: Callable[[int], int]
    share: float


def measure_scaling(
    camera: ij.PinholeCamera, kernel: Kernel | None, repeats: int, quick: bool
) -> Iterator[Metric]:
    """Time all curves, each with its sizes in turns, and fit their exponents.

    Args:
        camera: Of all curves but that of pixels.
        kernel: In C.
        repeats: Timed calls of a case; a curve takes its share of them.
        quick: Whether this is a trial.
    """
    for name, curve in CURVES.items():
        calls: Calls = {}
        medians: dict[str, list[tuple[int, float]]] = {}
        for size in curve.trial if quick else curve.sizes:
            for program, call in curve.calls(size, camera, kernel).items():
                calls[f"{program}.{curve.amount(size)}"] = call
        count = math.ceil(repeats * curve.share)
        for case, timing in time_in_turns(calls, count, warm_up=1).items():
            yield sample(f"scaling.{name}.{case}", timing.ms, "ms")
            program, amount = case.split(".")
            point = int(amount), float(np.median(timing.ms))
            medians.setdefault(program, []).append(point)
        for program, points in medians.items():
            label = f"scaling.{name}.{program}.exponent"
            amounts, times = zip(*points[-UPPER:], strict=True)
            yield growth(label, amounts, times)


def _frames(width: int, camera: ij.PinholeCamera, kernel: Kernel | None) -> Calls:
    """Depth, normal and mask of the can, in images of growing width."""
    del camera
    can, view = make_can(), make_view(width, width * 3 // 4)
    calls: Calls = {"jax": lambda: ij.render(can, view)}
    if kernel is not None:
        calls["c"] = kernel.frame(can, view, planes=False).call
    return calls


def _scenes(count: int, camera: ij.PinholeCamera, kernel: Kernel | None) -> Calls:
    """Depth, normal and index of a scene of cylinders."""
    many = make_many(count, SEED)
    scene = ij.Scene([many])
    calls: Calls = {"jax": lambda: ij.render(scene, camera, OUTPUTS)}
    if kernel is not None:
        calls["c"] = kernel.scene(many, camera).call
    return calls


def _batch(count: int, camera: ij.PinholeCamera, kernel: Kernel | None) -> Calls:
    """Loss and gradient of every can of a batch, each with an image of its own."""
    del kernel
    can, shape = make_can(), (camera.width // COARSE, camera.height // COARSE)
    view = make_view(*shape)
    center = np.tile(np.asarray(can.center), (count, 1))
    center[:, 0] += np.linspace(0, 0.01, count)
    axis = np.tile(np.asarray(can.axis), (count, 1))
    radius, height = np.full(count, can.radius), np.full(count, can.height)
    cans = ij.Cylinder(center, axis, radius, height)
    every = jax.jit(jax.vmap(jax.value_and_grad(larger_can_loss(view))))
    return {"jax": lambda: every(cans)}


def _parameters(count: int, camera: ij.PinholeCamera, kernel: Kernel | None) -> Calls:
    """Loss of a scene's depth and its gradient in all fields of all its cylinders."""
    del kernel
    many = make_many(count, SEED)
    larger = ij.Cylinder(many.center, many.axis, 1.02 * many.radius, many.height)
    target = ij.render(ij.Scene([larger]), camera, ("depth",)).depth
    assert target is not None

    def loss(many: ij.Cylinder) -> Float[Array, ""]:
        depth = ij.render(ij.Scene([many]), camera, ("depth",)).depth
        assert depth is not None
        return squared_difference(depth, target)

    both = jax.jit(jax.value_and_grad(loss))
    return {"jax": lambda: both(many)}


CURVES = {
    "pixels": Curve(
        calls=_frames,
        sizes=(160, 320, 640, 1280, 1920),
        trial=(80, 160),
        amount=lambda width: width * (width * 3 // 4),
        share=0.25,
    ),
    "cylinders": Curve(
        calls=_scenes,
        sizes=(10, 100, 1000, 10_000, 100_000),
        trial=(4,),
        amount=lambda count: count,
        share=0.025,
    ),
    "batch": Curve(
        calls=_batch,
        sizes=(1, 4, 16, 64),
        trial=(2,),
        amount=lambda count: count,
        share=0.25,
    ),
    "parameters": Curve(
        calls=_parameters,
        sizes=(1, 10, 100, 1000),
        trial=(4,),
        amount=lambda count: PER_CYLINDER * count,
        share=0.05,
    ),
}
"""By the name of what grows."""
