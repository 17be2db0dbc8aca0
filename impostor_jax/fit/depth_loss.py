"""How far a rendered depth is from a measured one: a loss for gradient descent."""

__all__ = ["depth_loss"]

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.arguments import one_of, real_number, unmasked
from impostor_jax.fit.robust import KERNELS, robust_residual
from impostor_jax.rendering.maps import GeometryMaps
from impostor_jax.sensor.surface import has_surface

FARTHEST = 1e6
"""Widths of the kernel beyond which a difference counts as that many: its square, and
what the derivative divides by it, are normal numbers in single precision."""


def depth_loss(
    maps: GeometryMaps,
    target: Any,
    mask: Any = None,
    sigma: Any = 0.001,
    kernel: str = "pseudo_huber",
    outline: bool = False,
    gap: Any = 0.1,
) -> Float[Array, ""]:
    """Mean robust square of the differences in depth, in standard deviations.

        def loss(can):
            return ij.depth_loss(ij.render(can, camera), depth, sigma=0.002)

        value, gradient = jax.value_and_grad(loss)(can)

    Only pixels count in which both see something, so that an outline has no pull: a
    shape beside its target has the loss 0. Begin where the two overlap, add a term in
    `coverage`, or let outlines count:

        def loss(scene):
            maps = ij.render(scene, camera, ("depth", "share", "beside"))
            return ij.depth_loss(maps, depth, sigma=0.002, outline=True)

    Of a pixel that an edge crosses both sides count then, each by its area, so that the
    edge moves to where they fit; and so does a pixel in which one sees something and
    the other nothing. A reading is that of the pixel's center, so that this loss is not
    0 at the truth, and its least is off by a part of a pixel: end without outlines.

    Args:
        maps: As of `render`, with the depth.
        target: (H, W), depth in meters, in which 0, NaN and infinity mean no reading;
            or other maps.
        mask: (H, W), True on the pixels that count; None for all.
        sigma: Standard deviation of a reading, in meters.
        kernel: Robust loss, as in `Effort`. "pseudo_huber" grows with the difference
            and pulls from afar; "geman_mcclure" forgets what is far; "squares" is the
            mean square.
        outline: Whether outlines count. The maps hold share and beside then, and of a
            target infinity means that nothing is there, which counts.
        gap: Difference in meters that counts, with `outline`, where one sees something
            and the other nothing, and at most elsewhere.

    Returns:
        About 1 where the two differ by the noise alone; 0 where no pixel counts.

    Raises:
        ValueError: A map has no depth, or, for an outline, no share or beside, the
            shapes differ, or an argument is out of range.

    Derivatives:
        Finite in the maps, the target and sigma, also where either misses. That in a
        difference of more than a million widths of the kernel is 0. With an outline, in
        the shapes whose edges move, too, of first order as `trace` has it.
    """
    one_of("kernel", kernel, KERNELS)
    real_number("sigma", sigma, positive=True, unit="meters")
    real_number("gap", gap, positive=True, unit="meters")
    rendered, measured = _depth_of("maps", maps), _depth_of("target", target)
    if measured.shape != rendered.shape:
        raise ValueError(
            f"target must have the shape of the maps {rendered.shape}, got "
            f"{measured.shape}"
        )
    measured = measured.astype(rendered.dtype)
    counts = has_surface(measured)
    if outline:
        counts |= jnp.isposinf(measured)
    else:
        counts &= has_surface(rendered)
    if mask is not None:
        mask = jnp.asarray(unmasked(mask))
        if mask.shape != rendered.shape or mask.dtype != bool:
            raise ValueError(
                f"mask must be of booleans of the shape {rendered.shape}, got "
                f"{mask.dtype} of shape {mask.shape}"
            )
        counts &= mask

    def lost(depth: Float[Array, "h w"]) -> Float[Array, "h w"]:
        """Loss of each pixel, of one depth in it."""
        both = counts & has_surface(depth) & has_surface(measured)
        # Both are finite before they are subtracted: inf - inf has a derivative of NaN,
        # even where it is not taken.
        difference = jnp.where(both, depth, 0) - jnp.where(both, measured, 0)
        if outline:
            most = jnp.asarray(gap, difference.dtype)
            difference = jnp.clip(difference, -most, most)
            one = counts & (has_surface(depth) != has_surface(measured))
            difference = jnp.where(one, most, difference)
        _, width = KERNELS[kernel]
        residual = difference / jnp.asarray(sigma, difference.dtype)
        residual = jnp.clip(residual, -FARTHEST * width, FARTHEST * width)
        return robust_residual(residual, width, kernel) ** 2

    losses = lost(rendered)
    if outline:
        share, beside = _sides_of(maps)
        losses = share * losses + (1 - share) * lost(beside)
    count = jnp.maximum(jnp.sum(counts), 1).astype(losses.dtype)
    return jnp.sum(losses) / count


def _sides_of(maps: Any) -> tuple[Float[Array, "h w"], Float[Array, "h w"]]:
    """Share of what the center sees in each pixel, and the depth beside it."""
    is_there = isinstance(maps, GeometryMaps)
    if not is_there or maps.share is None or maps.beside is None:
        raise ValueError(
            "maps must hold share and beside for an outline: ask render for them in "
            "outputs"
        )
    return maps.share, maps.beside


def _depth_of(name: str, seen: Any) -> Float[Array, "h w"]:
    depth = seen.depth if isinstance(seen, GeometryMaps) else seen
    if depth is None:
        raise ValueError(f"{name} must hold the depth: ask render for it in outputs")
    depth = depth if isinstance(depth, jax.Array) else np.asarray(unmasked(depth))
    if depth.ndim != 2 or not jnp.issubdtype(depth.dtype, np.floating):
        raise ValueError(
            f"{name} must be floating-point meters of shape (H, W), got {depth.dtype} "
            f"of shape {depth.shape}"
        )
    return jnp.asarray(depth)
