"""Render a shape or a scene, with as much work as is asked for.

Every map but the coverage is of the rays through the centers of pixels. A depth that is
the mean of several rays would be that of no surface, so more samples change the
coverage alone.
"""

__all__ = ["render"]

import dataclasses
import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from impostor_jax.arguments import is_concrete, one_of, real_number, working_precision
from impostor_jax.camera.base import AbstractCamera, not_accepted
from impostor_jax.camera.pixels import Tile
from impostor_jax.compiling import kept
from impostor_jax.device import is_processor
from impostor_jax.effort import Effort, effort_of
from impostor_jax.numerics import Scalar
from impostor_jax.primitives.base import AbstractPrimitive, check_single, not_a_shape
from impostor_jax.primitives.local_world import seen_near
from impostor_jax.rendering.clipping import Clipping, clipping_of
from impostor_jax.rendering.coverage import coverage
from impostor_jax.rendering.maps import OUTPUTS, GeometryMaps
from impostor_jax.rendering.raycast import raycast
from impostor_jax.rendering.sampling import framed, places_within
from impostor_jax.rendering.scene import Scene, Shown
from impostor_jax.rendering.sides import check_edges, sides_of
from impostor_jax.rendering.tile import outline_box, outline_tile
from impostor_jax.rendering.touched import BLOCK, blank, cast_touched, placed


def render(
    primitive: Shown,
    camera: AbstractCamera,
    outputs: Sequence[str] = ("depth", "normal", "mask"),
    tile: Tile | None = None,
    effort: Effort | str = "balanced",
    miss: float = math.inf,
    near: Any = None,
    far: Any = None,
) -> GeometryMaps:
    """Render a shape or a scene; only the outputs that are asked for are computed.

    Works inside `jax.jit`, `grad`, `jacfwd` and `vmap`, over shapes and over cameras
    of one image size. A camera and shapes far from the origin are seen as from near by:
    their numbers meet in double precision. Not so what is traced, or came in single
    precision, which is on that grid: at 500 km one of 3 cm.

    Args:
        primitive: One shape, in the world frame; map a batch with `jax.vmap`. Or a
            `Scene` of shapes, of which the closest is seen.
        camera: The camera; without a pose its frame is the world.
        outputs: Any of depth, range, point, normal, mask, index, part, coverage, and
            share and beside, in which edges move.
        tile: Block of pixels to render, the whole image if None. `outline_tile` gives
            the smallest one that shows the shape.
        effort: How much work it takes: "fast", "balanced" or "exact", or an `Effort`
            with a setting of each dial.
        miss: Depth, range and point of a pixel that hits nothing.
        near: Depth in meters, as the map `depth` has it, in front of which everything
            is cut away; None for 0. Of a solid that is cut the inside is seen. It may
            be traced, as `far` may. A surface at the very depth, to rounding, may be
            seen or not.
        far: Depth in meters behind which everything is cut away; None for no end.

    Returns:
        The maps in the camera frame, of the shape of the tile, or of every n-th
        row and column of it, n the stride of the effort.

    Raises:
        ValueError: An output is unknown, the shape is a batch, or the effort cannot be
            had: the exact coverage of a scene, or of a shape without an outline in
            closed form; several samples with a lens or a `SphericalCamera`; a traced
            shape in a precision that is not JAX's own; a miss that is NaN; a near
            that is negative, or a far that is not more; the exact coverage of what
            they cut.

    Derivatives:
        Those of the primitives, finite everywhere; 0 on a miss, and in near and far,
        with which nothing moves that is seen. A loss needs a target
        that is finite, too: NaN or infinity in one, where `jnp.where` does not take it,
        still makes the gradient NaN. `depth_loss` minds that,

            def loss(can):
                return ij.depth_loss(ij.render(can, camera), depth)

        and a target that is rendered with `miss=0.0` has no such pixel:

            target = ij.render(can, camera, miss=0.0)

            def loss(can):
                maps = ij.render(can, camera, miss=0.0)
                both = maps.mask & target.mask
                return jnp.where(both, (maps.depth - target.depth) ** 2, 0).sum()
    """
    if isinstance(outputs, str):
        raise ValueError(f"outputs must be a sequence of names, got {outputs!r}")
    for name in outputs:
        one_of("outputs", name, OUTPUTS)
    if not isinstance(primitive, Shown):
        raise ValueError(
            "primitive must be a shape, or an ij.Scene of a list of shapes, got "
            f"{not_a_shape(primitive)}"
        )
    if not isinstance(camera, AbstractCamera):
        raise ValueError(
            "camera must be a camera, such as an ij.PinholeCamera, got "
            f"{not_accepted(camera)}"
        )
    if isinstance(primitive, AbstractPrimitive):
        check_single(primitive)
    if miss != math.inf:
        miss = real_number("miss", miss, unit="meters")
    effort = effort_of(effort)
    clipping = clipping_of(near, far, camera)
    if _has_sides(outputs):
        check_edges(camera, "outputs must hold no share and no beside")
    given = (primitive, camera, tile, clipping)
    with working_precision(effort.precision, given) as converted:
        camera, primitive = seen_near(camera, primitive)
        primitive, camera = converted((primitive, camera))
        stride = effort.stride
        has_coverage = "coverage" in outputs
        samples = _samples(primitive, effort, clipping) if has_coverage else 0
        asked = (tuple(sorted(set(outputs))), stride, samples)
        if effort.extent == "tile" and tile is None and _has_tile(primitive, camera):
            assert isinstance(primitive, AbstractPrimitive)
            small = outline_tile(
                primitive, camera, margin=int(has_coverage or _has_sides(outputs))
            )
            small = _on_grid(small, camera, stride)
            maps = _render_in_frame(primitive, camera, small, clipping, *asked)
        elif _is_cast_in_blocks(primitive, camera, tile, clipping, *asked):
            assert isinstance(primitive, AbstractPrimitive)
            maps = _render_in_blocks(primitive, camera, clipping, asked[0])
        else:
            maps = _render(primitive, camera, tile, clipping, *asked)
        return maps if miss == math.inf else _with_miss(maps, miss)


@jax.jit
def _with_miss(maps: GeometryMaps, miss: Scalar) -> GeometryMaps:
    """The maps with another number for what is infinite."""
    depth, range_, point, beside = jax.tree.map(
        lambda values: jnp.where(jnp.isfinite(values), values, miss),
        (maps.depth, maps.range, maps.point, maps.beside),
    )
    return dataclasses.replace(
        maps, depth=depth, range=range_, point=point, beside=beside
    )


def _has_sides(outputs: Sequence[str]) -> bool:
    return "share" in outputs or "beside" in outputs


def _samples(primitive: Shown, effort: Effort, clipping: Clipping | None) -> int:
    """Rays along each side of a pixel for the coverage; 0 for the exact area."""
    if effort.outline == "hard":
        return 1
    if effort.samples > 1:
        return effort.samples
    if isinstance(primitive, Scene) or clipping is not None:
        what = "a scene" if clipping is None else "what near and far cut"
        raise ValueError(
            "effort must have samples of 2 or more, or a hard outline, for the "
            f"coverage of {what}, whose exact area is not known"
        )
    return 0


def _has_tile(primitive: Shown, camera: AbstractCamera) -> bool:
    """Whether the tile around what is seen is smaller than the frame, and known."""
    return (
        isinstance(primitive, AbstractPrimitive)
        and primitive.is_bounded
        and is_concrete((primitive, camera))
    )


def _is_cast_in_blocks(
    primitive: Shown,
    camera: AbstractCamera,
    tile: Tile | None,
    clipping: Clipping | None,
    outputs: tuple[str, ...],
    stride: int,
    samples: int,
) -> bool:
    """Whether `_render_in_blocks` gives the maps that `_render` does, and sooner.

    Its loop has no derivative backwards, and would run all blocks of a batch as often
    as those of its largest shape.
    """
    rows, cols = BLOCK
    return (
        tile is None
        and stride == 1
        and not _has_sides(outputs)
        and "coverage" not in outputs
        and camera.height >= 4 * rows
        and camera.width >= 2 * cols
        # A graphics card casts all rays at a time.
        and is_processor()
        and is_concrete(clipping)
        and _has_tile(primitive, camera)
    )


def _on_grid(tile: Tile, camera: AbstractCamera, stride: int) -> Tile:
    """A concrete tile, grown to begin at a pixel that is rendered."""
    row, col = (int(start) // stride * stride for start in (tile.row, tile.col))
    height = min(tile.height + stride - 1, camera.height - row)
    width = min(tile.width + stride - 1, camera.width - col)
    return Tile(row, col, height, width)


@partial(kept, static_argnames=("outputs", "stride", "samples"))
def _render(
    primitive: Shown,
    camera: AbstractCamera,
    tile: Tile | None,
    clipping: Clipping | None,
    outputs: tuple[str, ...],
    stride: int,
    samples: int,
) -> GeometryMaps:
    """The maps of a tile; the arguments are what decides what is compiled.

    Outputs are in the order of their names, and samples as `_samples` tells them.
    """
    tile = camera.frame if tile is None else tile
    row, col = (pixel[::stride, ::stride] for pixel in tile.pixels())
    if _has_sides(outputs):
        # One pixel more on each side, with which those at the border are compared.
        wide = framed(row, stride, 0), framed(col, stride, 1)
        maps = raycast(primitive, camera, *wide, "normal" in outputs, clipping)
        seen = *wide, maps["index"], maps["part"]
        share, beside = sides_of(primitive, camera, *seen, clipping)
        maps = {**maps, "share": share, "beside": beside}
        maps = jax.tree.map(lambda x: x[1:-1, 1:-1], maps)
    else:
        maps = raycast(primitive, camera, row, col, "normal" in outputs, clipping)
    if "coverage" in outputs:
        if samples == 1:
            covered = maps["mask"].astype(primitive.dtype)
        elif samples:
            covered = _sampled_coverage(primitive, camera, row, col, samples, clipping)
        else:
            assert isinstance(primitive, AbstractPrimitive)
            covered = coverage(primitive, camera, tile)[::stride, ::stride]
        maps["coverage"] = covered
    return GeometryMaps(**{name: maps[name] for name in outputs})


def _sampled_coverage(
    primitive: Shown,
    camera: AbstractCamera,
    row: Int[Array, "h w"],
    col: Int[Array, "h w"],
    samples: int,
    clipping: Clipping | None,
) -> Float[Array, "h w"]:
    """Share of a square grid of rays in each pixel that hit anything."""

    def add(total: Float[Array, "h w"], place: Float[Array, "2"]):
        moved = camera.shifted(place[0], place[1])
        maps = raycast(primitive, moved, row, col, False, clipping)
        return total + maps["mask"].astype(total.dtype), None

    blank = jnp.zeros(row.shape, primitive.dtype)
    places = jnp.asarray(places_within(samples), blank.dtype)
    total, _ = jax.lax.scan(add, blank, places)
    return total / samples**2


@partial(kept, static_argnames=("outputs", "stride", "samples"))
def _render_in_frame(
    primitive: AbstractPrimitive,
    camera: AbstractCamera,
    tile: Tile,
    clipping: Clipping | None,
    outputs: tuple[str, ...],
    stride: int,
    samples: int,
) -> GeometryMaps:
    """The maps of the whole image, of which a tile shows all that is seen."""
    maps = _render(primitive, camera, tile, clipping, outputs, stride, samples)
    height, width = -(-camera.height // stride), -(-camera.width // stride)
    row, col = jnp.asarray(tile.row) // stride, jnp.asarray(tile.col) // stride
    return placed(blank(maps, height, width), maps, row, col)


@partial(kept, static_argnames="outputs")
def _render_in_blocks(
    primitive: AbstractPrimitive,
    camera: AbstractCamera,
    clipping: Clipping | None,
    outputs: tuple[str, ...],
) -> GeometryMaps:
    """The maps of the whole image, of which the shape covers some blocks."""

    def cast(seen: tuple[Any, ...], tile: Tile) -> GeometryMaps:
        primitive, camera, clipping = seen
        return _render(primitive, camera, tile, clipping, outputs, 1, 0)

    box = outline_box(primitive, camera)
    return cast_touched(cast, (primitive, camera, clipping), box, camera.frame)
