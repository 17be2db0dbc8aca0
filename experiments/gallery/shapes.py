"""Every primitive in one scene: shaded, and the maps that the shading is made of."""

__all__ = ["draw"]

from collections.abc import Iterator

import matplotlib.patheffects as patheffects
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

import impostor_jax as ij
from experiments.gallery.panel import MISSING, show
from experiments.recording import Metric

UP = (0.0, 1.0, 0.0)

FINENESS = 2
"""Rays per row and column of a drawn pixel, which smooth the edges."""

FARTHEST = 5.0
"""End of the color map of depth in meters; the plane goes on to the horizon."""

HILLS = ij.Terrain(
    amplitude=0.35, frequency=np.pi / 2.0, gain=0.125, lacunarity=2.0, octaves=4
)
"""All octaves are 0 where the first is, and none outweighs it: no islands there."""

COS, SIN = np.cos(0.5), np.sin(0.5)

SHAPES: dict[str, tuple[str, ij.AbstractPrimitive]] = {
    "Plane": ("#9aa0a8", ij.Plane((0.0, 0.0, 0.0), UP)),
    "Heightfield": (
        "#7f9a5c",
        ij.Heightfield(
            HILLS,
            ((-4.0, 4.0), (-4.0, 0.0)),
            lipschitz=HILLS.lipschitz,
            curvature=HILLS.curvature,
            # Sunk by a millimeter: at its border it would lie in the plane.
            world_from_field=ij.RigidTransform(np.eye(3), (0.7, -1e-3, -0.5)),
        ),
    ),
    "Cylinder": ("#cf4b3c", ij.Cylinder((-0.57, 0.17, 0.0), UP, 0.1, 0.34)),
    "Cylinder, open": (
        "#e0912f",
        ij.Cylinder((-0.42, 0.08, 0.5), (1.0, 0.0, -0.75), 0.08, 0.3, caps=False),
    ),
    "Cylinder, sector": (
        "#4a78b8",
        ij.Cylinder(
            (-0.1, 0.11, 0.14), UP, 0.15, 0.22, -2.3, 2.3, zero=(0.2, 0.0, -1.0)
        ),
    ),
    "Sphere": ("#dcb83c", ij.Sphere((0.0, 0.09, 0.56), 0.09)),
    "Frustum, cone": (
        "#8a62ad",
        ij.Frustum((0.2, 0.0, -0.08), (0.2, 0.4, -0.08), 0.13, 0.0),
    ),
    "Frustum, open": (
        "#2f9c95",
        ij.Frustum((0.53, 0.0, 0.16), (0.53, 0.22, 0.16), 0.08, 0.12, caps=False),
    ),
    "Box": (
        "#b8705a",
        ij.Box(
            (0.36, 0.07, 0.5),
            ((COS, 0.0, SIN), (0.0, 1.0, 0.0), (-SIN, 0.0, COS)),
            (0.26, 0.14, 0.12),
        ),
    ),
}
"""Color of each shape, and the shape."""

LIGHTS = [ij.AmbientLight(0.28), ij.DirectionalLight((-1.0, 0.9, 0.5), 0.9)]

LABELS = {"Plane": (0.92, 0.92), "Heightfield": (0.42, 0.41)}
"""Parts of width and height where a name is written that no single spot has."""


def camera(width: int) -> ij.PinholeCamera:
    """A little above the shapes, which it looks down at."""
    height = width * 5 // 8
    focal = 1.25 * width
    position = np.array((0.0, 0.75, 2.15))
    forward = np.array((0.0, 0.26, -0.15)) - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, UP)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return ij.PinholeCamera(
        focal,
        focal,
        (width - 1) / 2,
        (height - 1) / 2,
        width,
        height,
        camera_from_world=ij.RigidTransform(rotation, -rotation @ position),
    )


def draw(width: int) -> tuple[Figure, list[Metric]]:
    """Draw the scene, `width` pixels wide, and count the pixels that see each shape."""
    view = camera(FINENESS * width)
    scene = ij.Scene([shape for _, shape in SHAPES.values()])
    outputs = ("depth", "point", "normal", "mask", "index")
    maps = ij.render(scene, view, outputs=outputs)
    assert maps.depth is not None
    mask, index = np.asarray(maps.mask), np.asarray(maps.index)
    missing = _rgb(MISSING)
    palette = np.array([_rgb(color) for color, _ in SHAPES.values()])
    colors = np.where(mask[..., None], palette[index], missing)
    light = ij.shade(
        maps,
        view,
        LIGHTS,
        color=_linear(colors),
        exponent=40.0,
        background=_linear(missing),
    )
    shaded = np.clip(np.asarray(light), 0, 1) ** (1 / 2.2)
    normal = np.where(mask[..., None], (1 - np.asarray(maps.normal)) / 2, missing)
    depth = np.where(mask, np.asarray(maps.depth), np.nan)

    figure = Figure(figsize=(10, 6.75))
    figure.subplots_adjust(0.004, 0.006, 0.996, 0.965, wspace=0.016, hspace=0.085)
    (first, second), (third, fourth) = figure.subplots(2, 2)
    show(first, shaded, "shaded")
    nearest = float(np.nanmin(depth))
    shown = show(second, depth, "depth, m", limits=(nearest, FARTHEST))
    inset = second.inset_axes((0.955, 0.05, 0.02, 0.5))
    figure.colorbar(shown, cax=inset, extend="max", ticks=[2, 3, 4, 5])
    inset.tick_params(labelsize=8, colors="white")
    inset.yaxis.tick_left()
    show(third, normal, "normals")
    show(fourth, colors, "index: which shape each pixel sees")
    _write_names(fourth, index)
    return figure, list(_counts(index))


def _write_names(axes: Axes, index: np.ndarray) -> None:
    """Write the name of each shape onto it."""
    halo = patheffects.withStroke(linewidth=2, foreground="0.15")
    height, width = index.shape
    for order, name in enumerate(SHAPES):
        if name in LABELS:
            col, row = LABELS[name][0] * width, LABELS[name][1] * height
        else:
            rows, cols = np.nonzero(index == order)
            row, col = rows.mean(), cols.mean()
        axes.text(
            col,
            row,
            name.replace(", ", ",\n"),
            ha="center",
            va="center",
            color="white",
            fontsize=8.5,
            linespacing=0.95,
            path_effects=[halo],
        )


def _counts(index: np.ndarray) -> Iterator[Metric]:
    for order, name in enumerate(SHAPES):
        part = float(np.mean(index == order))
        key = name.lower().replace(", ", "_")
        yield Metric(f"shapes.{key}.seen", part, None, "part", "higher", index.size)


def _rgb(color: str) -> np.ndarray:
    """Red, green and blue of a color as matplotlib writes it."""
    return np.array(to_rgb(color), np.float32)


def _linear(color: np.ndarray) -> np.ndarray:
    """Light of a color on a screen."""
    return color**2.2
