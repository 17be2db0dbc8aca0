"""A can, a cup and a ball, fitted to one noisy depth image; which one is the cup."""

__all__ = ["draw"]

import dataclasses
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import impostor_jax as ij
from experiments.gallery.panel import MISSING, show
from experiments.recording import Metric

SIGMA = 0.001
NOISE = ij.Dropout(ij.ConstantNoise(SIGMA), rate=0.01)

FOCAL, CENTER, SIZE = 525.0, (143.5, 75.5), (288, 224)
TOP = 24
"""First row that is shown."""

HALF = 62.0
"""Half a side of what is shown of each shape, in pixels."""

FINENESS = 4
"""Rays per row and column of a pixel, for the outlines."""

RADIUS, HEIGHT = 0.040, 0.120
"""Of can and ball, and of the wide end of the cup, in meters."""

NARROW = 0.037
"""Radius of the cup's other end."""

UP = np.array((0.0, -0.88, -0.475)) / np.linalg.norm((0.0, -0.88, -0.475))
NEARER = np.cross((1.0, 0.0, 0.0), UP)
TABLE = np.array((0.0, 0.1, 0.7))
PLACES = ((-0.1, 0.03), (0.1, 0.03), (0.0, -0.07))
"""Of can, cup and ball on the table: to the right, and towards the camera."""

LEAST = 0.0001
"""Probabilities below are not told apart."""

OUTLINE = "#e4572e"

Image = Float[np.ndarray, "h w"]
Mask = Bool[np.ndarray, "h w"]


@dataclasses.dataclass(frozen=True)
class Radius:
    """A radius, in meters.

    Attributes:
        name: Which one.
        found: By the fit.
        std: Its standard deviation, as the fit gives it.
        true: None where the fitted shape is not the true one.
    """

    name: str
    found: float
    std: float
    true: float | None


@dataclasses.dataclass(frozen=True)
class Fitted:
    """A fitted shape, and what is written about it."""

    name: str
    kind: str
    shape: ij.AbstractPrimitive
    radii: tuple[Radius, ...]
    fit: ij.Fit
    p_value: float | None = None
    """Probability that noise makes a cylinder look as tapered."""

    @property
    def title(self) -> str:
        """Three lines above its residuals."""
        found = ", ".join(f"{1e3 * radius.found:.2f}" for radius in self.radii)
        std = max(radius.std for radius in self.radii)
        name = "radius" if len(self.radii) == 1 else "radii"
        last = f"rms {1e3 * self.rms:.2f} mm"
        if self.p_value is not None:
            low = self.p_value < LEAST
            p = f"p < {LEAST}" if low else f"p = {self.p_value:.2f}"
            last += f", taper: {p}"
        middle = f"{name} {found} ± {1e3 * std:.2f} mm"
        return f"{self.name}, as a {self.kind}\n{middle}\n{last}"

    @property
    def rms(self) -> float:
        """Of all residuals, outliers too, in meters."""
        return float(np.sqrt(np.mean(self.residual[self.used] ** 2)))

    @property
    def residual(self) -> Image:
        """Reading less fit, in meters."""
        return np.asarray(self.fit.residual, float)

    @property
    def used(self) -> Mask:
        """Pixels with a reading that was fitted."""
        return np.asarray(self.fit.region) & (self.residual != 0)


def camera(fineness: int = 1) -> ij.PinholeCamera:
    """The camera, or the same view with finer pixels."""
    cx, cy = (fineness * (place + 0.5) - 0.5 for place in CENTER)
    width, height = (fineness * size for size in SIZE)
    return ij.PinholeCamera(
        fineness * FOCAL, fineness * FOCAL, cx, cy, width=width, height=height
    )


def truth() -> dict[str, ij.AbstractPrimitive]:
    """The shapes, of which all but the table are fitted."""
    can, cup, ball = (TABLE + np.array((x, 0.0, 0.0)) + z * NEARER for x, z in PLACES)
    return {
        "can": ij.Cylinder(can + UP * (HEIGHT / 2), UP, RADIUS, HEIGHT),
        "cup": ij.Frustum(cup, cup + UP * HEIGHT, NARROW, RADIUS),
        "ball": ij.Sphere(ball + UP * RADIUS, RADIUS),
        "table": ij.Plane(TABLE, UP),
    }


def draw(seed: int) -> tuple[Figure, list[Metric]]:
    """Draw readings, fit the shapes to them, and show the residuals."""
    shapes = truth()
    view = camera()
    outputs = ("depth", "normal", "index")
    maps = ij.render(ij.Scene(list(shapes.values())), view, outputs=outputs)
    assert maps.depth is not None
    assert maps.normal is not None
    readings = np.asarray(
        NOISE.sample(jax.random.key(seed), maps.depth, maps.normal, view)
    )
    index = np.asarray(maps.index)
    masks = {name: index == order for order, name in enumerate(shapes)}

    fits = []
    for name in ("can", "cup"):
        fit = ij.fit_cylinder(readings, view, mask=masks[name], sigma=SIGMA)
        test = ij.test_taper(fit)
        true = RADIUS if name == "can" else None
        found = fit.cylinder.radius, fit.std.radius
        radii = (_radius("radius", *found, true),)
        p_value = float(test.p_value)
        fits.append(Fitted(name, "cylinder", fit.cylinder, radii, fit, p_value))
        if name == "cup":
            fit = test.frustum
            fits.append(Fitted(name, "frustum", fit.frustum, _ends(fit), fit))
    fit = ij.fit_sphere(readings, view, mask=masks["ball"], sigma=SIGMA)
    radii = (_radius("radius", fit.sphere.radius, fit.std.radius, RADIUS),)
    fits.insert(1, Fitted("ball", "sphere", fit.sphere, radii, fit))
    return _figure(readings, fits), list(_metrics(fits))


def _radius(name: str, found: object, std: object, true: float | None) -> Radius:
    return Radius(name, float(np.asarray(found)), float(np.asarray(std)), true)


def _ends(fit: ij.Fit) -> tuple[Radius, ...]:
    """Radii of the cup, the narrow one first: the fit decides which end is p1."""
    cup, std = fit.frustum, fit.std
    pairs = [(cup.radius1, std.radius1), (cup.radius2, std.radius2)]
    narrow, wide = sorted((float(found), float(std)) for found, std in pairs)
    return (_radius("narrow", *narrow, NARROW), _radius("wide", *wide, RADIUS))


def _figure(readings: Image, fits: list[Fitted]) -> Figure:
    """The readings with the outlines, beside the residuals of each fit."""
    figure = Figure(figsize=(10, 4.9), layout="constrained")
    parts: Any = figure.subfigures(1, 2, width_ratios=(1.08, 1))
    left, right = parts
    image = left.subplots()
    depth = np.where(readings > 0, readings, np.nan)[TOP:]
    show(
        image,
        depth,
        "noisy depth, and the outlines that were found",
        colorbar="m",
        extent=(-0.5, SIZE[0] - 0.5, SIZE[1] - 0.5, TOP - 0.5),
        interpolation="nearest",
    )
    for fitted in fits:
        if (fitted.name, fitted.kind) != ("cup", "cylinder"):
            _outline(image, fitted.shape)
    image.set(xlim=(-0.5, SIZE[0] - 0.5), ylim=(SIZE[1] - 0.5, TOP - 0.5))
    limit = 3e3 * SIGMA
    panels = right.subplots(2, 2)
    for axes, fitted in zip(panels.flat, fits, strict=True):
        residual = np.where(fitted.used, 1e3 * fitted.residual, np.nan)
        show(
            axes,
            residual,
            fitted.title,
            "RdBu",
            (-limit, limit),
            interpolation="nearest",
        )
        axes.title.set_fontsize(8.5)
        axes.set_facecolor(MISSING)
        _outline(axes, fitted.shape)
        rows, cols = np.nonzero(fitted.used)
        row, col = (rows.min() + rows.max()) / 2, (cols.min() + cols.max()) / 2
        axes.set(xlim=(col - HALF, col + HALF), ylim=(row + HALF, row - HALF))
    shown = panels[0, 0].images[0]
    bar = right.colorbar(
        shown, ax=panels, shrink=0.8, aspect=35, pad=0.02, extend="both"
    )
    bar.set_label("reading less fit, mm", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    return figure


def _outline(axes: Axes, shape: ij.AbstractPrimitive) -> None:
    """Draw where a shape ends in the image."""
    fine = camera(FINENESS)
    mask = np.asarray(ij.render(shape, fine, outputs=("mask",)).mask)
    col = (np.arange(fine.width) + 0.5) / FINENESS - 0.5
    row = (np.arange(fine.height) + 0.5) / FINENESS - 0.5
    axes.contour(col, row, mask, levels=[0.5], colors=OUTLINE, linewidths=1.2)


def _metrics(fits: list[Fitted]) -> Iterator[Metric]:
    for fitted in fits:
        label = f"fits.{fitted.name}.{fitted.kind}"
        count = int(fitted.used.sum())
        yield Metric(f"{label}.rms", fitted.rms, None, "m", "lower", count)
        for radius in fitted.radii:
            if radius.true is not None:
                off = abs(radius.found - radius.true)
                key = f"{label}.{radius.name}.off"
                yield Metric(key, off, radius.std, "m", "lower", count)
        if fitted.p_value is not None:
            better = "lower" if fitted.name == "cup" else "higher"
            yield Metric(f"{label}.p_value", fitted.p_value, None, "1", better, count)
