"""The depth image beside the scene: a colored picture, and outlines in its pixels."""

__all__ = ["outline_path", "picture_url", "png_url", "svg_path"]

import base64

import matplotlib
import numpy as np
from jaxtyping import Float, UInt8
from skimage.measure import find_contours

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.opencv import cv2
from impostor_jax.page.shown import ImageView
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.rendering.render import render
from impostor_jax.viewer.figure import fitted_outline

COLORS = "cividis"
"""Of depths, near ones dark: all outlines differ from them."""

MISSING = 110
"""Gray where there is no reading."""

MARGIN = 0.05
"""Of the nearest and farthest readings, those that share the last color, beside those
of fits."""


def picture_url(view: ImageView) -> str:
    """A depth image as the URL of a PNG of its size, which holds it."""
    return png_url(_levels(view))


def png_url(
    picture: UInt8[np.ndarray, "h w"] | UInt8[np.ndarray, "h w 3"], *options: int
) -> str:
    """A picture as the URL of a PNG, which holds it; `options` are OpenCV's."""
    encoded = cv2.imencode(".png", picture, options)[1]
    return "data:image/png;base64," + base64.b64encode(encoded.tobytes()).decode()


def _levels(view: ImageView) -> UInt8[np.ndarray, "h w 3"]:
    """Blue, green and red of the depths."""
    valid = view.depth > 0
    depths, of_fits = view.depth[valid], view.depth[valid & (view.owner >= 0)]
    ends = (100 * MARGIN, 100 - 100 * MARGIN)
    near, far = np.percentile(depths, ends) if depths.size else (0.0, 1.0)
    near, far = np.min(of_fits, initial=near), np.max(of_fits, initial=far)
    place = np.clip((view.depth - near) / max(far - near, 1e-9), 0, 1)
    colors = matplotlib.colormaps[COLORS](place, bytes=True)[..., 2::-1]
    return np.where(valid[..., None], colors, np.uint8(MISSING))


def outline_path(shape: AbstractPrimitive, camera: AbstractCamera) -> str:
    """Outline of a shape as the path of an SVG in image coordinates; "" without one."""
    if isinstance(shape, Cylinder | Sphere) and isinstance(camera, PinholeCamera):
        outline = fitted_outline(shape, camera)
        return "" if outline is None else svg_path(outline)
    mask = np.asarray(render(shape, camera, outputs=("mask",)).mask)
    # With a frame around it a curve closes also where it leaves the image.
    curves = find_contours(np.pad(mask, 1).astype(float), 0.5)
    return "".join(svg_path(curve[:, ::-1] - 1) for curve in curves)


def svg_path(points: Float[np.ndarray, "n 2"]) -> str:
    """The closed path of an SVG through points in image coordinates."""
    return "M" + "L".join(f"{u:.1f} {v:.1f}" for u, v in points) + "Z"
