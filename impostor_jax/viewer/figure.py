"""Pictures of fits: the depth image with outlines, and the residuals of one."""

__all__ = [
    "Drawn",
    "draw_shapes",
    "fitted_outline",
    "found_figure",
    "overlay_figure",
    "write_overlay",
]

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float
from matplotlib.figure import Figure

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.find.found import Found
from impostor_jax.fit.result import Fit
from impostor_jax.io.atomic import write_atomically
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.rendering.image_curve import image_curve
from impostor_jax.rendering.render import render

OUTLINE_STEPS = 1024
"""Points of an outline: at most 2 pixels apart at 640x480."""

COLORS = ("red", "orange", "magenta", "cyan")
"""Of outlines, in turn; none is of the depths."""


def fitted_outline(
    shape: Cylinder | Sphere, camera: PinholeCamera
) -> Float[np.ndarray, "n 2"] | None:
    """Closed outline of a shape in image coordinates (u, v), in pixels.

    It is exact in the image and may be pulled towards it beyond. None where there is no
    outline in front of the camera.
    """
    pixels, visible = _outline(shape, camera)
    return np.concatenate([pixels, pixels[:1]]) if bool(visible) else None


@jax.jit
def _outline(
    shape: Cylinder | Sphere, camera: PinholeCamera
) -> tuple[Float[Array, "n 2"], Bool[Array, ""]]:
    curve = image_curve(shape, camera, camera.frame)
    return curve.even_steps(OUTLINE_STEPS, margin=1).pixels, curve.visible


def overlay_figure(fit: Fit, depth: Any, camera: AbstractCamera) -> Figure:
    """Draw the depth image with the fitted outline, and the residual map.

    Args:
        fit: A single, concrete result of one image.
        depth: (H, W) as it was fitted, in meters.
        camera: The camera.

    Raises:
        ValueError: The fit is of several images, or of points.
    """
    if fit.source == "points":
        raise ValueError("fit must be of one image, got a fit to points")
    if isinstance(fit.region, tuple):
        raise ValueError(
            f"fit must be of one image, got one of {len(fit.region)}: ij.view shows all"
        )
    region = np.asarray(fit.region)
    rows, cols = np.nonzero(region)
    figure = Figure(figsize=(12, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    shape = fit.shape if fit.is_shape else None
    draw_shapes(left, depth, camera, [Drawn(region, shape)])
    left.set_title(f"depth, region used (white), fit: {fit.status}")

    residual_mm = np.where(region, 1e3 * np.asarray(fit.residual, float), np.nan)
    inliers = np.abs(residual_mm[np.asarray(fit.inliers)])
    limit = max(float(np.percentile(inliers, 99)), 1e-3) if inliers.size else 1.0
    image = right.imshow(residual_mm, cmap="RdBu", vmin=-limit, vmax=limit)
    figure.colorbar(image, ax=right, label="reading less fit (mm)", shrink=0.8)
    right.set_title("residual along the ray")
    if len(rows):
        margin = 0.15 * max(np.ptp(rows), np.ptp(cols)) + 10
        right.set_xlim(cols.min() - margin, cols.max() + margin)
        right.set_ylim(rows.max() + margin, rows.min() - margin)
    if shape is not None:
        _draw_outline(right, shape, camera, COLORS[0])
    _name_axes(right)
    return figure


def found_figure(found: Found, depth: Any, camera: AbstractCamera) -> Figure:
    """Draw the depth image with the cylinders that were found in it.

    Beside each stand its number, from 1, and its confidence.

    Args:
        found: The result.
        depth: (H, W) as it was searched, in meters.
        camera: The camera.
    """
    figure = Figure(
        figsize=(10, 1.2 + 8.4 * camera.height / camera.width), layout="constrained"
    )
    axes = figure.subplots()
    drawn = [
        Drawn(mask, fit.shape, f"{number}: {confidence:.2f}")
        for number, (mask, fit, confidence) in enumerate(
            zip(found.masks, found.fits, found.confidence, strict=True), start=1
        )
    ]
    draw_shapes(axes, depth, camera, drawn)
    axes.set_title(f"depth, {len(found)} found: pixels (white), number: confidence")
    return figure


class Drawn(NamedTuple):
    """What is drawn of one object.

    Attributes:
        region: Pixels that show it.
        shape: Of its outline, in the world frame; None where there is none.
        name: Stands beside the region.
    """

    region: Bool[np.ndarray, "h w"]
    shape: AbstractPrimitive | None
    name: str = ""


def draw_shapes(
    axes: Any, depth: Any, camera: AbstractCamera, drawn: Sequence[Drawn]
) -> None:
    """Draw a depth image, with regions and outlines of objects, on axes.

    Args:
        axes: Of matplotlib's.
        depth: (H, W), in meters; 0 or not finite where there is no reading.
        camera: The camera.
        drawn: The objects.
    """
    readings = np.asarray(depth, dtype=float)
    valid = np.isfinite(readings) & (readings > 0)
    near, far = np.percentile(readings[valid], (2, 98)) if valid.any() else (0, 1)
    shown = valid & np.any([one.region for one in drawn], axis=0)
    near = np.min(readings[shown], initial=near)
    image = axes.imshow(
        np.where(valid, readings, np.nan), cmap="viridis", vmin=near, vmax=far
    )
    axes.figure.colorbar(image, ax=axes, label="depth (m)", shrink=0.8)
    colors = itertools.cycle(COLORS)
    for (region, shape, name), color in zip(drawn, colors, strict=False):
        _draw_border(axes, region, "white", 0.5)
        if shape is not None:
            _draw_outline(axes, shape, camera, color)
        if name and region.any():
            _draw_name(axes, region, name, color)
    axes.set_xlim(-0.5, camera.width - 0.5)
    axes.set_ylim(camera.height - 0.5, -0.5)
    _name_axes(axes)


def _draw_outline(
    axes: Any, shape: AbstractPrimitive, camera: AbstractCamera, color: str
) -> None:
    if isinstance(shape, Cylinder | Sphere) and isinstance(camera, PinholeCamera):
        outline = fitted_outline(shape, camera)
        if outline is not None:
            axes.plot(*outline.T, color=color, linewidth=1.2)
    else:
        mask = render(shape, camera, outputs=("mask",)).mask
        _draw_border(axes, np.asarray(mask), color, 1.2)


def _draw_border(
    axes: Any, mask: Bool[np.ndarray, "h w"], color: str, linewidth: float
) -> None:
    if mask.any() and not mask.all():
        axes.contour(mask, levels=[0.5], colors=color, linewidths=linewidth)


def _draw_name(
    axes: Any, region: Bool[np.ndarray, "h w"], name: str, color: str
) -> None:
    """Write a name above a region, or in its upper end at the image's border."""
    top = int(np.argmax(region.any(axis=1)))
    height, width = region.shape
    is_above = top > 0.05 * height
    middle = np.median(np.flatnonzero(region[top]))
    axes.annotate(
        name,
        (np.clip(middle, 0.04 * width, 0.96 * width), top),
        xytext=(0, 4 if is_above else -4),
        textcoords="offset points",
        horizontalalignment="center",
        verticalalignment="bottom" if is_above else "top",
        fontsize=8,
        bbox={"facecolor": color, "edgecolor": "none", "pad": 1.5, "alpha": 0.8},
    )


def _name_axes(axes: Any) -> None:
    axes.set_xlabel("u (px)")
    axes.set_ylabel("v (px)")


def write_overlay(
    path: Path, result: Fit | Found, depth: Any, camera: AbstractCamera
) -> None:
    """Write `overlay_figure` of a fit, or `found_figure`, as a picture."""
    if isinstance(result, Found):
        figure = found_figure(result, depth, camera)
    else:
        figure = overlay_figure(result, depth, camera)
    write_atomically(path, lambda partial: figure.savefig(partial, dpi=110))
