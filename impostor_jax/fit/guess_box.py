"""First guesses of a box from a depth image, with no user input.

The commonest normal is that of a face. The commonest of those across it is that of
another; or else the face's edges tell, as the smallest rectangle around the points
along it. How far the points go along the three directions tells the size; a direction
of which one face alone is seen is taken for as long as the shorter of the others.
"""

__all__ = ["guess_boxes"]

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.fit.box_body import BoxBody, box_body
from impostor_jax.fit.rounds import FEWEST_POINTS, blank_where
from impostor_jax.fit.surface import Samples
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.geometry.vec3 import unit

ALIKE = np.cos(np.radians(15))
"""Cosine of the angle within which normals are of one face."""

ACROSS = np.sin(np.radians(20))
"""The same that a normal of another face makes with the first."""

TRIED = 128
"""Normals that are tried."""

TURNED = 45
"""Turns of a rectangle that are tried, within a right angle."""

OUTSIDE = 0.005
"""Share of the points at each end of a direction that are left out."""

THIN = 0.1
"""Length over the shorter of the two others, below which a direction shows one face."""


def guess_boxes(samples: Samples) -> tuple[BoxBody, Bool[Array, " g"]]:
    """Boxes in the camera frame, and which of them are any."""
    with jax.default_matmul_precision("highest"):
        normals = samples.normals
        every = jnp.ones(len(normals), normals.dtype)
        first, _ = _commonest(normals, every)
        aside = jnp.abs(jnp.sum(normals * first[None], axis=1)) < ACROSS
        second, share = _commonest(normals, jnp.where(aside, 1, 0).astype(every.dtype))
        second = unit(second - first * jnp.sum(first * second))
        by_edges = _along_edges(samples.points, first)
        # Of other faces a few normals are enough, which mixed readings are not.
        ways = [jnp.where(share > 0.05, second, by_edges), by_edges]
        boxes = [_around(samples, first, way) for way in ways]
    boxes = jax.tree.map(lambda *fields: jnp.stack(fields), *boxes)
    dtype = jnp.result_type(float)
    boxes = jax.tree.map(lambda field: field.astype(dtype), boxes)
    are_any = (samples.num_normals >= FEWEST_POINTS) & jnp.all(
        jnp.isfinite(boxes.half) & (boxes.half > 0), axis=1
    )
    return blank_where(~are_any, boxes), are_any


def _commonest(
    normals: Float[Array, "n 3"], weight: Float[Array, " n"]
) -> tuple[Float[Array, "3"], Float[Array, ""]]:
    """Direction to which most normals are close, and the share of them."""
    some = np.linspace(0, len(normals) - 1, TRIED).astype(int)
    close = jnp.matmul(normals[some], normals.T) > ALIKE
    votes = jnp.sum(jnp.where(close, weight[None], 0), axis=1) * weight[some]
    best = jnp.argmax(votes)
    chosen = jnp.where(close[best], weight, 0)
    mean = jnp.sum(normals * chosen[:, None], axis=0)
    return unit(mean), votes[best] / len(normals)


def _along_edges(
    points: Float[Array, "n 3"], normal: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Direction of an edge of the smallest rectangle around points on a face."""
    basis = tangent_basis(normal)
    flat = jnp.matmul(points, basis.T)
    angles = np.arange(TURNED) * (np.pi / 2 / TURNED)
    along = np.stack([np.cos(angles), np.sin(angles)])
    across = np.stack([-np.sin(angles), np.cos(angles)])
    sides = [
        jnp.max(reach, axis=0) - jnp.min(reach, axis=0)
        for reach in (
            jnp.matmul(flat, jnp.asarray(way, flat.dtype)) for way in (along, across)
        )
    ]
    best = jnp.argmin(sides[0] * sides[1])
    return jnp.matmul(jnp.asarray(along.T, flat.dtype)[best], basis)


def _around(
    samples: Samples, first: Float[Array, "3"], second: Float[Array, "3"]
) -> BoxBody:
    """The box with two of its axes given that holds all points."""
    points = samples.points
    frame = jnp.stack([first, second, jnp.cross(first, second)])
    reach = jnp.sort(jnp.matmul(points, frame.T), axis=0)
    least = round(OUTSIDE * len(points))
    low, high = reach[least], reach[-1 - least]
    extent = high - low
    others = jnp.stack([jnp.minimum(extent[k - 1], extent[k - 2]) for k in range(3)])
    # What is seen of such a one is the face towards the camera.
    is_thin = extent < THIN * others
    ahead = high + low > 0
    high = jnp.where(is_thin & ahead, low + others, high)
    low = jnp.where(is_thin & ~ahead, high - others, low)
    center = jnp.matmul(frame.T, (high + low) / 2)
    # Normals face the camera: of a room inward, and it is in there.
    away = samples.normal_points - center[None]
    is_room = jnp.sum(away * samples.normals) < 0
    margin = THIN * (high - low)
    low = jnp.where(is_room, jnp.minimum(low, -margin), low)
    high = jnp.where(is_room, jnp.maximum(high, margin), high)
    center = jnp.matmul(frame.T, (high + low) / 2)
    return box_body(center, frame, (high - low) / 2)
