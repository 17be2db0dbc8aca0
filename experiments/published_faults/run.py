"""Measure the faults of the published cylinder impostor, drawn by an OpenGL driver.

The driver draws the published formulas and ours; both are compared with JAX in double
precision, on the same parameters, rounded to single precision.
"""

__all__ = ["SHADERS", "Config", "measure"]

import contextlib
import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import impostor_jax as ij
from experiments.published_faults import report
from experiments.published_faults.report import tables
from experiments.recording import Metric, Results
from experiments.running import RunConfig, main
from impostor_jax.glsl.conventions import DrawnMaps
from impostor_jax.glsl.offscreen import OffscreenRenderer
from impostor_jax.parity.compare import angles_between
from impostor_jax.parity.run import drawn_by_jax

SHADERS = Path(__file__).parent / "shaders"
"""The published ones."""

SIZE = (320, 240)

RADIUS_PX = 40.0
"""Radius in the image."""

SLENDERNESS = (0.25, 1.0, 2.0, 4.0, 8.0)
"""Heights, in radii, of which the normals and the cut are measured."""

HALF_HEIGHTS = (0.01, 0.1, 0.4, 0.49, 0.51, 0.6, 1.0, 10.0)
"""Half heights in units, around the one at which a cap's normal turns over."""

DISTANCES = (3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4)
"""Distances, in radii, at which depth is measured."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure what goes wrong with the published formulas."""

    run: RunConfig = RunConfig()


@dataclasses.dataclass(frozen=True)
class Views:
    """One cylinder, as the published formulas, ours and double precision see it."""

    published: DrawnMaps
    ours: DrawnMaps
    exact: DrawnMaps


class Drivers:
    """Both programs on one driver."""

    def __init__(self) -> None:
        self.published = OffscreenRenderer(shaders=SHADERS)
        self.ours = OffscreenRenderer()

    def views(
        self,
        axis: Sequence[float] | np.ndarray,
        distance: float,
        radius: float = 1.0,
        slenderness: float = 3.0,
        depth: float | None = None,
    ) -> Views:
        """Views of a cylinder `distance` radii away, its radius 40 pixels wide.

        Args:
            axis: Of any length.
            distance: Of the center, in radii; sets the focal length.
            radius: In meters.
            slenderness: Height in radii.
            depth: Of the center, in radii, where it is not the distance: without it
                the camera stays outside.
        """
        place = distance if depth is None else depth
        center = np.array([0.3, -0.2, place]) * radius
        focal = RADIUS_PX * distance
        width, height = SIZE
        camera = ij.PinholeCamera(
            focal, focal, (width - 1) / 2, (height - 1) / 2, width, height
        )
        cylinder = ij.Cylinder(center, axis, radius, slenderness * radius)
        return Views(
            self.published.draw(cylinder, camera),
            self.ours.draw(cylinder, camera),
            drawn_by_jax(cylinder, camera, "float64"),
        )

    def close(self) -> None:
        """Release both."""
        self.published.close()
        self.ours.close()


def angles(found: DrawnMaps, exact: DrawnMaps, on_cap: bool) -> np.ndarray:
    """Angles between the normals in degrees, where both see the wall, or a cap."""
    both = found.mask & exact.mask
    both &= ((found.part > 0) == on_cap) & ((exact.part > 0) == on_cap)
    return angles_between(found.normal[both], exact.normal[both])


def normal_metrics(drivers: Drivers) -> list[Metric]:
    """Fault 1: the wall gets the normals of a sphere."""
    metrics = []
    for slenderness in SLENDERNESS:
        views = drivers.views((0.6, 0.8, 0.2), 20.0, slenderness=slenderness)
        for name in ("published", "ours"):
            found = angles(getattr(views, name), views.exact, on_cap=False)
            for part, value in (("mean", found.mean()), ("worst", found.max())):
                key = f"normals.{slenderness:g}.{name}.{part}"
                metrics.append(_metric(key, value, "deg", len(found)))
    return metrics


def cap_metrics(drivers: Drivers) -> list[Metric]:
    """Fault 2: the normal of one cap turns over where the cylinder is small."""
    metrics = []
    for half_height in HALF_HEIGHTS:
        # The camera sees the cap at -axis if the axis points away from it.
        for cap, sign in (("minus", 1.0), ("plus", -1.0)):
            axis = sign * np.array([0.3, 0.4, 0.8])
            views = drivers.views(axis, 20.0, radius=half_height, slenderness=2.0)
            for name in ("published", "ours"):
                found = angles(getattr(views, name), views.exact, on_cap=True)
                key = f"caps.{half_height:g}.{cap}.{name}.flipped"
                part = float(np.mean(found > 90))
                metrics.append(_metric(key, part, "1", len(found)))
    return metrics


def cut_metrics(drivers: Drivers) -> list[Metric]:
    """Faults 3 and 4: what the square cuts off, and what a camera inside misses."""
    metrics = []
    for slenderness in SLENDERNESS:
        for distance in (3.0, 20.0):
            near = distance < slenderness
            views = drivers.views(
                (0.5, 0.6, 0.0) if near else (0.5, 0.6, 0.5),
                distance,
                slenderness=slenderness,
            )
            for name in ("published", "ours"):
                key = f"cut.{slenderness:g}.{distance:g}.{name}"
                metrics.append(_missed(key, getattr(views, name), views.exact))
    inside = drivers.views((0.5, 0.6, 0.5), 1.0, slenderness=6.0, depth=0.3)
    for name in ("published", "ours"):
        key = f"inside.{name}"
        metrics.append(_missed(key, getattr(inside, name), inside.exact))
    return metrics


def _missed(name: str, found: DrawnMaps, exact: DrawnMaps) -> Metric:
    """Part of the cylinder's pixels that are not drawn, or at a wrong depth."""
    true = np.where(exact.mask, exact.depth, 1)
    apart = np.abs(np.where(found.mask, found.depth, np.inf) - true) / true
    wrong = exact.mask & ~(apart < 1e-2)
    count = np.count_nonzero(exact.mask)
    return _metric(name, np.count_nonzero(wrong) / count, "1", int(count))


def depth_metrics(drivers: Drivers, distances: Sequence[float]) -> list[Metric]:
    """Fault 5: the discriminant cancels as the distance grows."""
    metrics = []
    for distance in distances:
        views = drivers.views((0.6, 0.8, 0.2), distance)
        for name in ("published", "ours"):
            found = getattr(views, name)
            both = (found.part == 0) & (views.exact.part == 0)
            apart = np.abs(found.depth[both] - views.exact.depth[both])
            for part, value in (
                ("median", np.median(apart)),
                ("p99", np.percentile(apart, 99)),
                ("worst", apart.max()),
            ):
                key = f"depth.{distance:g}.{name}.{part}"
                metrics.append(_metric(key, float(value), "radii", len(apart)))
    return metrics


def _metric(name: str, value: float, unit: str, count: int) -> Metric:
    return Metric(name, float(value), None, unit, "lower", int(count))


def measure(config: Config) -> Iterator[Metric]:
    """Measure all faults."""
    with contextlib.closing(Drivers()) as drivers:
        yield from normal_metrics(drivers)
        yield from cap_metrics(drivers)
        yield from cut_metrics(drivers)
        yield from depth_metrics(
            drivers, DISTANCES[:2] if config.run.quick else DISTANCES
        )


def draw(results: Results) -> dict[str, Figure]:
    """Draw the faults, and one view of both programs."""
    with contextlib.closing(Drivers()) as drivers:
        shown = drivers.views((0.5, 0.6, 0.5), 4.0, radius=0.1, slenderness=4.0)
    return {"published_faults": report.draw(results, shown.published, shown.ours)}


if __name__ == "__main__":
    main(Config, measure, tables, Config(), draw)
