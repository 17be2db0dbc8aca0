"""What the pictures have in common: one image in its axes, and how it is written."""

__all__ = ["MISSING", "save", "show"]

import io
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from PIL import Image

from impostor_jax.io.atomic import write_atomically

MISSING = "0.88"
"""Gray of the pixels without a value."""


def show(
    axes: Axes,
    image: Any,
    title: str,
    cmap: str = "viridis",
    limits: tuple[float, float] | None = None,
    colorbar: str | None = None,
    extend: str = "neither",
    **options: Any,
) -> AxesImage:
    """Show an image without ticks; NaN is gray.

    Args:
        axes: Where to.
        image: (h, w), or (h, w, 3) of colors.
        title: Above it.
        cmap: Name of a color map, for numbers.
        limits: Numbers at the ends of the color map; those of the image if None.
        colorbar: What the numbers are; None for no bar.
        extend: Ends beyond which there are numbers: neither, min, max or both.
        **options: Of `imshow`.
    """
    colors = matplotlib.colormaps[cmap].with_extremes(bad=MISSING)
    low, high = (None, None) if limits is None else limits
    # Colors are averaged where several pixels fall into one, not the numbers.
    shown = axes.imshow(
        image, cmap=colors, vmin=low, vmax=high, interpolation_stage="rgba", **options
    )
    axes.set_title(title, fontsize=10)
    axes.set(xticks=[], yticks=[])
    if colorbar is not None:
        beside = axes.inset_axes((1.02, 0.0, 0.035, 1.0))
        bar = axes.figure.colorbar(shown, cax=beside, extend=extend)
        bar.set_label(colorbar, fontsize=9)
        bar.ax.tick_params(labelsize=8)
    return shown


def save(figure: Figure, path: Path, colors: int | None = None) -> int:
    """Write a picture as PNG; returns its size in bytes.

    Args:
        figure: The picture.
        path: Where to.
        colors: How many colors to keep, at most 256; None for all.
    """
    figure.savefig(drawn := io.BytesIO(), dpi=100, format="png")
    with Image.open(drawn) as full:
        image = full.convert("RGB")
    if colors is not None:
        image = image.quantize(colors, dither=Image.Dither.NONE)
    write_atomically(path, lambda partial: image.save(partial, optimize=True))
    return path.stat().st_size
