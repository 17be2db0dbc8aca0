"""Pictures of a fit: the depth image with the fitted outline, beside the residuals."""

__all__ = ["fitted_outline", "overlay_figure", "write_overlay"]

from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Bool, Float
from matplotlib.figure import Figure

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.result import Fit
from impostor_jax.io.atomic import write_atomically
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.rendering.image_curve import image_curve
from impostor_jax.rendering.render import render

OUTLINE_STEPS = 1024
"""Points of an outline: at most 2 pixels apart at 640x480."""


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


def overlay_figure(fit: Fit, depth: Any, camera: PinholeCamera) -> Figure:
    """Draw the depth image with the fitted outline, and the residual map.

    Args:
        fit: A single, concrete result.
        depth: (H, W) as it was fitted, in meters.
        camera: The camera.
    """
    readings = np.asarray(depth, dtype=float)
    readings = np.where(np.isfinite(readings) & (readings > 0), readings, np.nan)
    region = np.asarray(fit.region)
    rows, cols = np.nonzero(region)
    figure = Figure(figsize=(12, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2)

    near, far = np.nanpercentile(readings, (2, 98))
    if region.any():
        near = min(near, np.nanmin(readings[region]))
    image = left.imshow(readings, cmap="viridis", vmin=near, vmax=far)
    figure.colorbar(image, ax=left, label="depth (m)", shrink=0.8)
    if region.any():
        left.contour(region, levels=[0.5], colors="white", linewidths=0.5)
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

    if bool(fit.success):
        _draw_outline(left, fit.shape, camera)
        _draw_outline(right, fit.shape, camera)
    left.set_xlim(-0.5, camera.width - 0.5)
    left.set_ylim(camera.height - 0.5, -0.5)
    for axes in (left, right):
        axes.set_xlabel("u (px)")
        axes.set_ylabel("v (px)")
    return figure


def _draw_outline(axes: Any, shape: AbstractPrimitive, camera: PinholeCamera) -> None:
    if isinstance(shape, Cylinder | Sphere):
        outline = fitted_outline(shape, camera)
        if outline is not None:
            axes.plot(*outline.T, color="red", linewidth=1.2)
        return
    mask = render(shape, camera, outputs=("mask",)).mask
    if mask is not None and bool(mask.any()) and not bool(mask.all()):
        axes.contour(np.asarray(mask), levels=[0.5], colors="red", linewidths=1.2)


def write_overlay(path: Path, fit: Fit, depth: Any, camera: PinholeCamera) -> None:
    """Write `overlay_figure` as a picture."""
    figure = overlay_figure(fit, depth, camera)
    write_atomically(path, lambda partial: figure.savefig(partial, dpi=110))
