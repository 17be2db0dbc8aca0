"""Exact rendering: one ray through the center of every pixel."""

__all__ = ["render"]

from collections.abc import Callable, Sequence
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from impostor_jax.arguments import one_of
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.camera.pixels import Tile
from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.primitives.base import AbstractPrimitive, in_camera_frame
from impostor_jax.rendering.closest import closest
from impostor_jax.rendering.maps import OUTPUTS, GeometryMaps
from impostor_jax.rendering.scene import Scene

Seen = tuple[Hit, Int[Array, "h w"], Callable[[Hit], Vec3]]
"""What rays meet: the hit, which shape that is of, and the normal at a hit."""


def render(
    primitive: AbstractPrimitive | Scene,
    camera: AbstractCamera,
    outputs: Sequence[str] = ("depth", "normal", "mask"),
    tile: Tile | None = None,
) -> GeometryMaps:
    """Render a shape or a scene; only the outputs that are asked for are computed.

    Works inside `jax.jit`, `grad`, `jacfwd` and `vmap`, over shapes and over cameras
    of one image size.

    Args:
        primitive: One shape, in the world frame; map a batch with `jax.vmap`. Or a
            `Scene` of shapes, of which the closest is seen.
        camera: The camera; without a pose its frame is the world.
        outputs: Any of depth, range, point, normal, mask and index.
        tile: Block of pixels to render, the whole image if None. `outline_tile` gives
            the smallest one that shows the shape.

    Returns:
        The maps in the camera frame, of the shape of the tile.

    Raises:
        ValueError: An output is unknown or the shape is a batch.
    """
    if isinstance(outputs, str):
        raise ValueError(f"outputs must be a sequence of names, got {outputs!r}")
    for name in outputs:
        one_of("outputs", name, OUTPUTS)
    if isinstance(primitive, AbstractPrimitive) and primitive.batch_shape:
        raise ValueError(
            f"primitive must be a single one, got a batch of shape "
            f"{primitive.batch_shape}; map over it with jax.vmap"
        )
    return _render(primitive, camera, frozenset(outputs), tile)


@partial(jax.jit, static_argnames="outputs")
def _render(
    primitive: AbstractPrimitive | Scene,
    camera: AbstractCamera,
    outputs: frozenset[str],
    tile: Tile | None,
) -> GeometryMaps:
    tile = camera.frame if tile is None else tile
    row, col = tile.pixels()
    ray = camera.rays(row, col, primitive.dtype)
    if isinstance(primitive, Scene):
        hit, index, normal = _see_scene(primitive, camera, ray)
    else:
        hit, index, normal = _see_one(primitive, camera, ray)
    sees = camera.sees(row, col)
    if sees is not None:
        t = jnp.where(sees, hit.t, jnp.inf)
        hit = Hit(t=t, on_cap=hit.on_cap & sees, part=hit.part)
    maps = {}
    if "depth" in outputs:
        maps["depth"] = hit.t
    if "range" in outputs:
        maps["range"] = hit.t * ray.direction.norm()
    if "point" in outputs:
        point = ray.at(jnp.where(hit.mask, hit.t, 0)).stack()
        maps["point"] = jnp.where(hit.mask[..., None], point, jnp.inf)
    if "normal" in outputs:
        maps["normal"] = normal(hit).stack()
    if "mask" in outputs:
        maps["mask"] = hit.mask
    if "index" in outputs:
        maps["index"] = jnp.where(hit.mask, index, -1)
    return GeometryMaps(**maps)


def _see_one(primitive: AbstractPrimitive, camera: AbstractCamera, ray: Ray) -> Seen:
    primitive = in_camera_frame(primitive, camera)
    hit = primitive.intersect(ray)
    index = jnp.zeros(hit.t.shape, jnp.int32)
    return hit, index, lambda hit: primitive.normal(ray, hit)


def _see_scene(scene: Scene, camera: AbstractCamera, ray: Ray) -> Seen:
    """Find the closest shape of every ray, then cast each ray at that one alone.

    The search has no derivative. What it found is cast once more, with the fields of
    the shapes taken pixel by pixel, and that has.
    """
    groups = scene.seen_by(camera).groups
    many = [group for group in groups if group.index.shape[0] > 1]
    shape = ray.direction.z.shape
    hit = Hit.on_one_piece(jnp.full(shape, jnp.inf, scene.dtype))
    index = jnp.full(shape, -1, jnp.int32)
    place, nearest = closest(many, ray, camera.is_central) if many else (index, hit.t)
    seen = []
    first = 0
    for group in groups:
        count = group.index.shape[0]
        if count == 1:
            only = jax.tree.map(lambda x: x[0], group.primitives)
            found = only.intersect(ray)
            mine = found.t < jnp.minimum(hit.t, nearest)
            own_index = group.index[0]
        else:
            member = jnp.clip(place - first, 0, count - 1)
            mine = (first <= place) & (place < first + count) & (nearest < hit.t)
            only = jax.tree.map(lambda x, k=member: x[k], group.primitives)
            found = only.intersect(ray)
            # Two programs may round an outline's ray to either side.
            t = jnp.where(found.mask, found.t, nearest)
            found = Hit(t, found.on_cap, found.part)
            own_index = group.index[member]
            first += count
        hit = jax.tree.map(partial(jnp.where, mine), found, hit)
        index = jnp.where(mine, own_index, index)
        seen = [(before & ~mine, other) for before, other in seen] + [(mine, only)]

    def normal(hit: Hit) -> Vec3:
        zero = jnp.zeros_like(hit.t)
        total = Vec3(zero, zero, zero)
        for mine, only in seen:
            own = Hit(jnp.where(mine, hit.t, jnp.inf), hit.on_cap, hit.part)
            total = total + only.normal(ray, own)
        return total

    return hit, index, normal
