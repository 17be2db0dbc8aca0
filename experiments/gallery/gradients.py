"""Derivatives of a depth image and of pixel coverage, compared with differences."""

__all__ = ["draw"]

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

import impostor_jax as ij
from experiments.gallery.panel import show
from experiments.recording import Metric

DEGREE = np.pi / 180

UNITS = {"radius": 1e-3, "height": 1e-3, "axis": DEGREE}
"""What each derivative is per: millimeters, and degrees of tilt."""

STEP = 1e-5
"""Of the differences, in these units."""

Image = Float[np.ndarray, "h w"]


def can(name: str, by: Any) -> ij.Cylinder:
    """The can, with one of its sizes or its tilt changed, in units of `UNITS`."""
    by = by * UNITS[name]
    tilt = 0.9 + (by if name == "axis" else 0.0)
    lean, zero = 0.35, jnp.zeros_like(jnp.asarray(tilt))
    axis = jnp.stack([zero + lean, jnp.cos(tilt), jnp.sin(tilt)])
    return ij.Cylinder(
        jnp.asarray((0.0, 0.0, 0.5), axis.dtype),
        axis,
        0.04 + (by if name == "radius" else 0.0),
        0.12 + (by if name == "height" else 0.0),
    )


def camera(width: int) -> ij.PinholeCamera:
    """One that sees the can whole."""
    height = width * 7 // 8
    focal = 2.8 * width
    return ij.PinholeCamera(
        focal, focal, (width - 1) / 2, (height - 1) / 2, width, height
    )


def derivative(image_of: Any, name: str) -> tuple[Image, Image, Image]:
    """An image of the can, its derivative in one parameter, and by differences.

    The last is NaN where differences of two steps disagree: there one surface takes
    another's place.
    """

    @jax.jit
    def at(by: Any) -> Any:
        return image_of(can(name, by))

    still = jnp.zeros(())
    image, slope = jax.jvp(at, (still,), (jnp.ones(()),))

    def difference(step: float) -> Image:
        with np.errstate(invalid="ignore"):
            return (np.asarray(at(step)) - np.asarray(at(-step))) / (2 * step)

    once, twice = difference(STEP), difference(2 * STEP)
    with np.errstate(invalid="ignore"):
        smooth = np.abs(once - twice) < 1e-4 * (1 + np.abs(once))
    by_steps = np.where(smooth, once, np.nan)
    return np.asarray(image), np.asarray(slope), by_steps


def draw(width: int, coarse: int) -> tuple[Figure, list[Metric]]:
    """Draw the derivatives, and measure how far they are from differences.

    Args:
        width: Of the depth images, in pixels.
        coarse: Of the coverage images, whose pixels are to be seen.
    """
    fine_view, coarse_view = camera(width), camera(coarse)

    def depth_of(cylinder: ij.Cylinder) -> Any:
        maps = ij.render(cylinder, fine_view, outputs=("depth",))
        assert maps.depth is not None
        return 1e3 * maps.depth

    def coverage_of(cylinder: ij.Cylinder) -> Any:
        return ij.coverage(cylinder, coarse_view)

    layout = ConstrainedLayoutEngine(wspace=0.03, hspace=0.05)
    figure = Figure(figsize=(10, 5.7), layout=layout)
    panels = figure.subplots(2, 3)
    metrics = []
    # The derivatives do as well in single precision; differences need the digits.
    with jax.enable_x64(True):
        found = {name: derivative(depth_of, name) for name in UNITS}
        covered, edge, edge_by_steps = derivative(coverage_of, "radius")
    image = found["radius"][0]
    seen = np.isfinite(image)
    show(panels[0, 0], np.where(seen, image, np.nan), "depth", colorbar="mm")
    titles = {
        "radius": (panels[0, 1], "d depth / d radius", "mm per mm"),
        "height": (panels[0, 2], "d depth / d height", "mm per mm"),
        "axis": (panels[1, 0], "d depth / d tilt of the axis", "mm per degree"),
    }
    for name, (axes, title, unit) in titles.items():
        _, slope, by_steps = found[name]
        slope = np.where(seen, slope, np.nan)
        limit = float(np.nanpercentile(np.abs(slope), 97))
        show(
            axes,
            slope,
            title,
            "RdBu",
            (-limit, limit),
            colorbar=unit,
            extend="both",
        )
        metrics.append(_worst(f"depth.{name}", slope, by_steps))
    show(
        panels[1, 1],
        covered,
        f"coverage, {coarse} x {coarse_view.height} pixels",
        "cividis",
        (0, 1),
        colorbar="part of the pixel",
    )
    limit = float(np.abs(edge).max())
    show(
        panels[1, 2],
        edge,
        "d coverage / d radius",
        "RdBu",
        (-limit, limit),
        colorbar="1 / mm",
    )
    metrics.append(_worst("coverage.radius", edge, edge_by_steps))
    return figure, metrics


def _worst(name: str, slope: Image, by_steps: Image) -> Metric:
    """Largest deviation from the differences, relative to 1 + the derivative."""
    apart = np.abs(slope - by_steps) / (1 + np.abs(slope))
    count = int(np.isfinite(apart).sum())
    worst = float(np.nanmax(apart))
    return Metric(f"gradients.{name}.worst", worst, None, "1", "lower", count)
