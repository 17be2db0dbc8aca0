"""What is timed: fits of a can seen by cameras of any resolution."""

__all__ = [
    "VMAPPED",
    "View",
    "batch_cases",
    "fit_one",
    "fit_several",
    "see_can",
    "single_cases",
    "time_fits",
    "yardstick",
]

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

import impostor_jax as ij
from experiments.scenes import SIGMA, make_can, make_view, with_noise
from experiments.timing import WARM_UP, Timing, time_in_turns
from impostor_jax.effort import EFFORTS

VMAPPED = 8
"""Images of a batch inside `jax.vmap`, where all wait for the slowest."""

Calls = dict[str, Callable[[], ij.Fit]]


@dataclasses.dataclass(frozen=True)
class View:
    """Images of one can that differ in their noise.

    Attributes:
        can: In the camera frame.
        camera: That took them.
        mask: Pixels of the can, wall and caps.
        depths: What was read, in meters.
    """

    can: ij.Cylinder
    camera: ij.PinholeCamera
    mask: Bool[np.ndarray, "h w"]
    depths: Float[np.ndarray, "n h w"]

    def first(self, count: int) -> "View":
        """The same with this many images."""
        return dataclasses.replace(self, depths=self.depths[:count])


def see_can(scale: float, count: int) -> View:
    """Images by a camera with `scale` times as many rows and columns as 640x480."""
    can, camera = make_can(), make_view(round(640 * scale), round(480 * scale))
    maps = ij.render(can, camera)
    depth = np.asarray(maps.depth)
    depths = np.stack(
        [with_noise(depth, SIGMA, np.random.default_rng(k)) for k in range(count)]
    )
    return View(can, camera, np.asarray(maps.mask), depths)


def fit_one(view: View, is_masked: bool = True, **options: Any) -> ij.Fit:
    """Fit the first image."""
    mask = view.mask if is_masked else None
    return ij.fit_cylinder(view.depths[0], view.camera, mask, SIGMA, **options)


def fit_several(view: View, is_masked: bool = True, **options: Any) -> ij.Fit:
    """Fit all images, side by side."""
    masks = [view.mask] * len(view.depths) if is_masked else None
    return ij.fit_cylinders(view.depths, view.camera, masks, SIGMA, **options)


def single_cases(view: View) -> Calls:
    """Fits of one image."""
    radius = {"initial": view.can, "fixed": ("radius",)}
    calls: Calls = {}
    for effort in EFFORTS:
        calls[f"{effort}.mask"] = lambda e=effort: fit_one(view, effort=e)
        calls[f"{effort}.no_mask"] = lambda e=effort: fit_one(view, False, effort=e)
    calls["initial.mask"] = lambda: fit_one(view, initial=view.can)
    calls["known_radius.mask"] = lambda: fit_one(view, **radius)
    return calls


def yardstick(view: View) -> Callable[[], Any]:
    """NumPy's transform of the first image: what other machines can be compared by."""
    image = view.depths[0].astype(float)
    return lambda: np.fft.fft2(image)


def batch_cases(view: View) -> Calls:
    """Fits of all images, but for `vmap.mask`, which takes the first `VMAPPED`."""
    calls: Calls = {}
    for effort in ("balanced", "fast"):
        calls[f"{effort}.mask"] = lambda e=effort: fit_several(view, effort=e)
        calls[f"{effort}.no_mask"] = lambda e=effort: fit_several(view, False, effort=e)
    camera, depths = view.camera, jnp.asarray(view.depths[:VMAPPED])
    masks = jnp.stack([jnp.asarray(view.mask)] * VMAPPED)
    cans = jax.tree.map(lambda field: jnp.stack([field] * VMAPPED), view.can)
    mapped = jax.jit(
        jax.vmap(lambda d, m, c: ij.fit_cylinder(d, camera, m, SIGMA, initial=c))
    )
    calls["vmap.mask"] = lambda: mapped(depths, masks, cans)
    return calls


def time_fits(
    calls: Mapping[str, Callable[[], ij.Fit]],
    repeats: int,
    warm_up: int = WARM_UP,
    beside: Mapping[str, Callable[[], Any]] | None = None,
) -> dict[str, Timing]:
    """Time fits in turns, after each was compiled and found the can.

    Args:
        calls: The fits.
        repeats: Timed calls of each.
        warm_up: Calls before each block of them.
        beside: What is no fit, and timed with them.

    Raises:
        ValueError: One of them failed.
    """
    for name, call in calls.items():
        if not np.all(call().success):
            raise ValueError(f"a fit that is timed must succeed, got a failure: {name}")
    return time_in_turns({**calls, **(beside or {})}, repeats, warm_up)
