"""Exact rendering: one ray through the center of every pixel."""

__all__ = ["render"]

from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp

from impostor_jax.arguments import one_of
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.camera.pixels import Tile
from impostor_jax.geometry.rays import Hit
from impostor_jax.primitives.base import AbstractPrimitive, in_camera_frame
from impostor_jax.rendering.maps import OUTPUTS, GeometryMaps


def render(
    primitive: AbstractPrimitive,
    camera: AbstractCamera,
    outputs: Sequence[str] = ("depth", "normal", "mask"),
    tile: Tile | None = None,
) -> GeometryMaps:
    """Render a shape; only the outputs that are asked for are computed.

    Works inside `jax.jit`, `grad`, `jacfwd` and `vmap`, over shapes and over cameras
    of one image size.

    Args:
        primitive: One shape, in the world frame; map a batch with `jax.vmap`.
        camera: The camera; without a pose its frame is the world.
        outputs: Any of depth, range, point, normal and mask.
        tile: Block of pixels to render, the whole image if None. `outline_tile` gives
            the smallest one that shows the cylinder.

    Returns:
        The maps in the camera frame, of the shape of the tile.

    Raises:
        ValueError: An output is unknown or the shape is a batch.
    """
    if isinstance(outputs, str):
        raise ValueError(f"outputs must be a sequence of names, got {outputs!r}")
    for name in outputs:
        one_of("outputs", name, OUTPUTS)
    if primitive.batch_shape:
        raise ValueError(
            f"primitive must be a single one, got a batch of shape "
            f"{primitive.batch_shape}; map over it with jax.vmap"
        )
    return _render(primitive, camera, frozenset(outputs), tile)


@partial(jax.jit, static_argnames="outputs")
def _render(
    primitive: AbstractPrimitive,
    camera: AbstractCamera,
    outputs: frozenset[str],
    tile: Tile | None,
) -> GeometryMaps:
    tile = camera.frame if tile is None else tile
    primitive = in_camera_frame(primitive, camera)
    row, col = tile.pixels()
    ray = camera.rays(row, col, primitive.dtype)
    hit = primitive.intersect(ray)
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
        maps["normal"] = primitive.normal(ray, hit).stack()
    if "mask" in outputs:
        maps["mask"] = hit.mask
    return GeometryMaps(**maps)
