"""Readings at edges, which a sensor's noise model does not speak for.

They may be of what lies beside an object, or lean. What is written once runs on the
host, where only the object's part of an image is looked at, and in a trace.
"""

__all__ = ["without_edges"]

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from impostor_jax.camera.ray_table import Sight
from impostor_jax.effort import MIN_READINGS
from impostor_jax.fit.problem import DepthImage, Mask
from impostor_jax.fit.regions import STEEP, jump_parts
from impostor_jax.fit.surface import cropped
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.bias import Reach, is_none

BESIDE = 4
"""Pixels beside the farthest ones that count, which tell whether there is a hole."""

Marks = Bool[np.ndarray, "_ _"] | Bool[Array, "_ _"]


def without_edges(
    depth: DepthImage, region: Mask, camera: Sight, noise: AbstractDepthNoise
) -> DepthImage:
    """Leave out a region's readings that may be of what lies beside it, or lean.

    The first lie at the region's border, the others at a jump in depth or a hole. As
    many of the sensor's `edge_reach` and `window_reach` pixels are left out as leave
    enough readings.

    Args:
        depth: In meters; 0 where there is no reading. On the host it stays as it is
            where the sensor errs nowhere.
        region: Pixels of the object.
        camera: The camera.
        noise: Of the readings.
    """
    bias = noise.bias
    if not bias.errs_at_edges:
        return depth
    mixed, leaning = bias.edge_reach, bias.window_reach
    if not (isinstance(depth, np.ndarray) and isinstance(region, np.ndarray)):
        return _left(depth, jnp.asarray(region), camera, noise, mixed, leaning, jnp)
    mixed, leaning = int(mixed), int(leaning)
    box = cropped(region, margin=mixed + leaning + BESIDE)
    left = depth.copy()
    left[box] = _left(depth[box], region[box], camera, noise, mixed, leaning, np)
    return left


def _left(
    depth: DepthImage,
    region: Mask,
    camera: Sight,
    noise: AbstractDepthNoise,
    mixed: Reach,
    leaning: Reach,
    xp: Any,
) -> DepthImage:
    """What is left of an image's readings, or of the part where the region lies.

    Those within `mixed` pixels of the region's border may be of another surface, those
    within `leaning` pixels of a jump lean.
    """
    if not is_none(mixed):
        # A hole of a pixel or two is no edge: there the mask just says less.
        outside = ~_closed(region, xp)
        depth = _without(depth, region, outside, partial(_crossed, xp=xp), mixed, xp)
    if is_none(leaning):
        return depth
    at_jumps = _at_jumps(depth, camera, noise, xp)

    def grown(edges: Marks) -> Marks:
        # A jump lies between two pixels, which are its first.
        return at_jumps | _largest(xp.pad(edges, 1))

    return _without(depth, region, xp.zeros_like(region), grown, leaning, xp)


def _closed(region: Marks, xp: Any) -> Marks:
    """A region and the holes in it that are less than three pixels wide."""
    # Beyond the border it is as it is at the border.
    grown = xp.pad(_largest(xp.pad(region, 1)), 1, mode="edge")
    return region | ~_largest(~grown)


def _largest(padded: Marks) -> Marks:
    """Whether any pixel of each one's 3 x 3 is."""
    rows = padded[:-2] | padded[1:-1] | padded[2:]
    return rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:]


def _crossed(edges: Marks, xp: Any) -> Marks:
    """The same of each one and its four neighbors.

    Beyond the image's border nothing is known to lie.
    """
    padded = xp.pad(edges, 1)
    rows = padded[2:, 1:-1] | padded[:-2, 1:-1]
    return edges | rows | padded[1:-1, :-2] | padded[1:-1, 2:]


def _without(
    depth: DepthImage,
    region: Mask,
    edges: Marks,
    grown: Callable[[Marks], Marks],
    reach: Reach,
    xp: Any,
) -> DepthImage:
    """Leave out a region's readings at edges that grow while enough are left."""

    def widened(_: Any, edges: Marks) -> Marks:
        more = grown(edges)
        enough = xp.sum(region & ~more & (depth > 0)) >= MIN_READINGS
        return xp.where(enough, more, edges)

    if xp is np:
        for _ in range(int(reach)):
            edges = widened(_, edges)
    else:
        edges = jax.lax.fori_loop(0, reach, widened, edges)
    return xp.where(region & edges, 0, depth)


def _at_jumps(
    depth: DepthImage, camera: Sight, noise: AbstractDepthNoise, xp: Any
) -> Marks:
    """Pixels with a neighbor along a row or column on another surface, or in a hole."""
    has = depth > 0
    noisy, width = jump_parts(depth, camera, noise, xp)
    reach = noisy + STEEP * width
    # The hole of a pixel or two is a reading that is missing.
    is_hole = ~_closed(has, xp)

    def jumps(axis: int) -> Marks:
        def both(of: Any) -> tuple[Any, Any]:
            return (of[:-1], of[1:]) if axis == 0 else (of[:, :-1], of[:, 1:])

        (near, far), (a, b), (c, d) = both(depth), both(has), both(is_hole)
        is_jump = a & b & (xp.abs(near - far) > xp.maximum(*both(reach))) | c | d
        before, after = [(0, 0), (0, 0)], [(0, 0), (0, 0)]
        before[axis], after[axis] = (0, 1), (1, 0)
        return xp.pad(is_jump, before) | xp.pad(is_jump, after)

    return jumps(0) | jumps(1)
