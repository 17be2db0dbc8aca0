"""Pictures of a fit: the depth image with the fitted outline, beside the residuals."""

__all__ = ["fitted_outline", "overlay_figure", "write_overlay"]

from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.fit.result import Fit
from impostor_jax.io.atomic import write_atomically
from impostor_jax.primitives.base import AbstractPrimitive, in_camera_frame
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.rendering.outline import in_front, outline_points
from impostor_jax.rendering.render import render


def fitted_outline(
    cylinder: Cylinder, camera: PinholeCamera
) -> Float[np.ndarray, "n 2"] | None:
    """Closed outline of a cylinder in image coordinates (u, v), in pixels.

    None where the cylinder is not wholly in front of the camera.
    """
    cylinder = in_camera_frame(cylinder, camera)
    if not bool(in_front(cylinder)):
        return None
    corners = np.asarray(outline_points(cylinder))
    closed = np.concatenate([corners, corners[:1]])
    # Straight edges bend under a lens: fill them with points.
    steps = np.linspace(0, 1, 8, endpoint=False)[None, :, None]
    filled = closed[:-1, None] * (1 - steps) + closed[1:, None] * steps
    points = np.concatenate([filled.reshape(-1, 2), corners[:1]])
    rays = np.concatenate([points, np.ones_like(points[:, :1])], axis=1)
    return np.asarray(camera.project(jnp.asarray(rays, corners.dtype)))


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
    outline = fitted_outline(shape, camera) if isinstance(shape, Cylinder) else None
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
