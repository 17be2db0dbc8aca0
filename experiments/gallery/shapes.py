"""Every primitive in one scene: a traced picture, and its maps."""

__all__ = ["draw"]

import itertools
import math
from collections.abc import Iterator
from typing import Any

import matplotlib.patheffects as patheffects
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

import impostor_jax as ij
from experiments.gallery.panel import MISSING, show
from experiments.recording import Metric
from impostor_jax.io.color_image import srgb

UP = (0.0, 1.0, 0.0)

FINENESS = 2
"""Rays per row and column of a drawn pixel, which smooth the edges."""

FARTHEST = 5.0
"""End of the color map of depth in meters; the plane goes on to the horizon."""

HILLS = ij.Terrain(
    amplitude=0.35, frequency=np.pi / 2.0, gain=0.125, lacunarity=2.0, octaves=4
)
"""All octaves are 0 where the first is, and none outweighs it: no islands there."""

SKY = (0.5, 0.66, 0.85)
"""Light that comes from where nothing is."""

BOUNCES = 6
"""Of a ray: through the glass ball, to the mirror and back again."""

SHINY: dict[str, float | bool] = {"exponent": 40.0}

COS, SIN = np.cos(0.5), np.sin(0.5)

GOLDEN = (1 + np.sqrt(5)) / 2


def icosahedron(center: tuple[float, float, float], radius: float) -> ij.Triangle:
    """Mesh of 20 triangles, which rests on one of them.

    Args:
        center: In meters.
        radius: Of the sphere through its corners.
    """
    signs = [(a, b) for a in (-1.0, 1.0) for b in (-GOLDEN, GOLDEN)]
    corners = np.array([np.roll((0.0, a, b), k) for k in range(3) for a, b in signs])
    corners /= np.linalg.norm(corners[0])
    # Corners of a face are next to each other: the products of others are less.
    near = corners @ corners.T > 0.4
    faces = [
        corners[[i, j, k]]
        for i, j, k in itertools.combinations(range(12), 3)
        if near[i, j] and near[j, k] and near[i, k]
    ]
    faces = [f if np.linalg.det(f) > 0 else f[::-1] for f in faces]
    y = -faces[0].mean(axis=0)
    y /= np.linalg.norm(y)
    x = np.cross(y, faces[0][0])
    x /= np.linalg.norm(x)
    world = np.stack([x, y, np.cross(x, y)])
    return ij.Triangle(np.array(center) + radius * np.array(faces) @ world.T)


SHAPES: dict[str, tuple[str, ij.AbstractPrimitive, dict[str, float | bool]]] = {
    "Plane": ("#9aa0a8", ij.Plane((0.0, 0.0, 0.0), UP), {"reflect": 0.08}),
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
        {},
    ),
    "Cylinder": ("#cf4b3c", ij.Cylinder((-0.62, 0.17, 0.0), UP, 0.1, 0.34), SHINY),
    "Cylinder, open": (
        "#e0912f",
        ij.Cylinder((-0.47, 0.08, 0.46), (1.0, 0.0, -0.75), 0.08, 0.3, caps=False),
        SHINY,
    ),
    "Cylinder, sector": (
        "#4a78b8",
        ij.Cylinder(
            (-0.02, 0.11, 0.06), UP, 0.15, 0.22, -2.3, 2.3, zero=(0.2, 0.0, -1.0)
        ),
        SHINY,
    ),
    "Sphere, mirror": (
        "#f2f2f2",
        ij.Sphere((-0.3, 0.14, 0.06), 0.14),
        {"exponent": 200.0, "reflect": 0.9},
    ),
    "Sphere, glass": (
        "#ffffff",
        ij.Sphere((0.12, 0.11, 0.5), 0.11),
        {"exponent": 200.0, "transmit": 0.97, "ior": 1.5, "fresnel": True},
    ),
    "Frustum, cone": (
        "#8a62ad",
        ij.Frustum((0.28, 0.0, -0.08), (0.28, 0.4, -0.08), 0.13, 0.0),
        SHINY,
    ),
    "Frustum, open": (
        "#2f9c95",
        ij.Frustum((0.6, 0.0, 0.12), (0.6, 0.22, 0.12), 0.08, 0.12, caps=False),
        SHINY,
    ),
    "Box": (
        "#b8705a",
        ij.Box(
            (0.42, 0.07, 0.47),
            ((COS, 0.0, SIN), (0.0, 1.0, 0.0), (-SIN, 0.0, COS)),
            (0.24, 0.14, 0.12),
        ),
        SHINY,
    ),
    "Torus": ("#dcb83c", ij.Torus((-0.13, 0.035, 0.56), UP, 0.085, 0.035), SHINY),
    "Solid": (
        "#4f8fcf",
        (
            ij.Cylinder((0.3, 0.075, 0.24), UP, 0.075, 0.15)
            | ij.Torus((0.375, 0.075, 0.24), (0.0, 0.0, 1.0), 0.045, 0.013)
        )
        - ij.Cylinder((0.3, 0.085, 0.24), UP, 0.063, 0.15),
        SHINY,
    ),
    "Triangles": ("#c77ba0", icosahedron((-0.2, 0.0635, 0.3), 0.08), SHINY),
}
"""Color of each shape, the shape, and what else its material has."""

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
    scene = ij.Scene([shape for _, shape, _ in SHAPES.values()])
    outputs = ("depth", "normal", "mask", "index")
    maps = ij.render(scene, view, outputs=outputs)
    assert maps.depth is not None
    mask, index = np.asarray(maps.mask), _shape_of_index()[np.asarray(maps.index)]
    missing = _rgb(MISSING)
    palette = np.array([_rgb(color) for color, _, _ in SHAPES.values()])
    colors = np.where(mask[..., None], palette[index], missing)
    picture = srgb(_traced(scene, camera(width)))
    normal = np.where(mask[..., None], (1 - np.asarray(maps.normal)) / 2, missing)
    depth = np.where(mask, np.asarray(maps.depth), np.nan)

    figure = Figure(figsize=(10, 6.75))
    figure.subplots_adjust(0.004, 0.006, 0.996, 0.965, wspace=0.016, hspace=0.085)
    (first, second), (third, fourth) = figure.subplots(2, 2)
    show(first, picture, "traced: shadows, a mirror and glass")
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


def _traced(scene: ij.Scene, view: ij.PinholeCamera) -> np.ndarray:
    """Light of each pixel, the mean over its parts."""
    materials = [
        _material(color, shape.batch_shape, more)
        for color, shape, more in SHAPES.values()
    ]
    parts = (np.arange(FINENESS) + 0.5) / FINENESS - 0.5
    total = np.zeros((view.height, view.width, 3))
    for row, col in itertools.product(parts, parts):
        moved = view.shifted(col, row)
        total += np.asarray(
            ij.trace(scene, moved, LIGHTS, materials, SKY, depth=BOUNCES)
        )
    return total / FINENESS**2


def _material(
    color: str, batch: tuple[int, ...], more: dict[str, float | bool]
) -> ij.Material:
    """The material of a shape, or of all triangles of a mesh."""
    given: dict[str, Any] = {
        name: value if isinstance(value, bool) else np.full(batch, value)
        for name, value in more.items()
    }
    return ij.Material(np.broadcast_to(_linear(_rgb(color)), (*batch, 3)), **given)


def _shape_of_index() -> np.ndarray:
    """Place in `SHAPES` of each index of the scene; a mesh has one of each triangle."""
    counts = [math.prod(shape.batch_shape) for _, shape, _ in SHAPES.values()]
    # The last one is of index -1.
    return np.append(np.repeat(np.arange(len(SHAPES)), counts), -1)


def _linear(color: np.ndarray) -> np.ndarray:
    """Light of a color on a screen."""
    return color**2.2
