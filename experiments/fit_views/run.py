"""Fit a can to one, two and four views around it, and compare with the joint bound."""

__all__ = ["Config", "measure"]

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

import impostor_jax as ij
from experiments.errors import error, joint_bound
from experiments.fit_views.report import COMPARED, draw, tables
from experiments.fitting import bias, over_bound
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.scenes import (
    DISTANCE,
    HEIGHT,
    RADIUS,
    WALL,
    View,
    make_view,
    with_noise,
)
from impostor_jax.fit.fittable import CYLINDER

NOISE = {"1mm": 1e-3, "3mm": 3e-3}

COUNTS = (1, 2, 4)
"""Views, evenly around the can."""

RAISED = (15.0, 40.0)
"""Angles in degrees by which a camera is above the can, or below it."""

NORMAL_95 = 1.96
"""Half the width of the 95 percent interval of a normal deviate."""

BOUNDED = 10
"""One of so many cans whose bound is computed: it hardly differs between them."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure what more views of a can tell of it."""

    run: RunConfig = RunConfig()
    seeds: int = 200
    """Cans of each number of views and noise."""
    seed: int = 0
    """Of all draws."""


@dataclasses.dataclass(frozen=True)
class Around:
    """Views of a can, and the cameras that took them."""

    can: ij.Cylinder
    views: list[View]
    cameras: list[ij.PinholeCamera]

    def fit(self, plainly: bool = False) -> ij.Fit:
        """Fit what was read, or what would be without noise."""
        depths = [view.depth for view in self.views]
        if plainly:
            depths = [_read(self.can, camera)[0] for camera in self.cameras]
        return ij.fit_cylinder(
            depths,
            self.cameras,
            mask=[view.mask for view in self.views],
            sigma=self.views[0].sigma,
            initial=self.can if plainly else None,
        )

    def bound(self, reachable: bool = False) -> Float[np.ndarray, " k"]:
        """Of the depths of all views.

        They leave an end open that no view sees; the places where it stops in the
        images tell of it, each uniform within a pixel. What all that tells is what a
        fit to exact images says.

        Args:
            reachable: As of `joint_bound`.
        """
        of_depths = joint_bound(self.views, self.cameras, reachable=reachable)
        of_all = np.sqrt(np.diagonal(np.asarray(self.fit(plainly=True).covariance)))
        return np.where(np.isfinite(of_depths), of_depths, of_all)


def measure(config: Config) -> Iterator[Metric]:
    """Errors over the joint bound, deviations, biases, intervals and failures."""
    some = 1 if config.run.quick else None
    for noise, sigma in list(NOISE.items())[:some]:
        for count in (2,) if config.run.quick else COUNTS:
            rng = np.random.default_rng(config.seed)
            cans = [_draw(count, sigma, rng) for _ in range(config.seeds)]
            yield from _compared(f"views.{count}.{noise}", cans)


def _draw(count: int, sigma: float, rng: np.random.Generator) -> Around:
    """A can, tilted by up to 20 degrees, and cameras around it."""
    tilt = rng.normal(0, np.radians(10), 2)
    can = ij.Cylinder(rng.uniform(-0.02, 0.02, 3), (*tilt, 1), RADIUS, HEIGHT)
    first, below = rng.uniform(0, 360), rng.integers(2)
    views, cameras = [], []
    for k in range(count):
        turn = np.radians(first + k * 360 / count)
        raised = np.radians(rng.uniform(*RAISED)) * (-1) ** (k + below)
        camera = _looking(turn, raised)
        depth, mask = _read(can, camera)
        views.append(View(can, with_noise(depth, sigma, rng), mask, sigma))
        cameras.append(camera)
    return Around(can, views, cameras)


def _looking(turn: float, raised: float) -> ij.PinholeCamera:
    """A camera that looks at the origin, upright."""
    towards = -np.array(
        [np.cos(turn) * np.cos(raised), np.sin(turn) * np.cos(raised), np.sin(raised)]
    )
    right = np.cross(towards, (0, 0, 1.0))
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = right, np.cross(towards, right), towards
    pose[2, 3] = DISTANCE
    plain = make_view(640, 480)
    intrinsics = (plain.fx, plain.fy, plain.cx, plain.cy, plain.width, plain.height)
    return ij.PinholeCamera(*intrinsics, camera_from_world=pose)


def _read(
    can: ij.Cylinder, camera: ij.PinholeCamera
) -> tuple[Float[np.ndarray, "h w"], np.ndarray]:
    """Depth and mask without noise, in front of a wall that each camera has."""
    maps = ij.render(can, camera, outputs=("depth", "mask"))
    depth = np.minimum(np.asarray(maps.depth), WALL)
    return depth, np.asarray(maps.mask)


def _compared(label: str, cans: list[Around]) -> Iterator[Metric]:
    errors, deviations, failures = [], [], 0
    for around in cans:
        fit = around.fit()
        if not fit.success:
            failures += 1
            continue
        errors.append(error(fit.cylinder, around.can))
        deviations.append(np.sqrt(np.diagonal(np.asarray(fit.covariance))))
    yield Metric(f"{label}.failures", failures, None, "cans", "lower", len(cans))
    errors, deviations = np.array(errors), np.array(deviations)
    some = cans[::BOUNDED]
    least = np.array([around.bound() for around in some])
    reachable = np.array([around.bound(reachable=True) for around in some])
    for name in COMPARED:
        k = CYLINDER.coordinates.index(name)
        off, n = errors[:, k], len(errors)
        yield over_bound(f"{label}.{name}.over_bound", off, least[:, k])
        yield over_bound(f"{label}.{name}.over_reachable", off, reachable[:, k])
        rms = float(np.sqrt(np.mean(off**2)))
        yield Metric(f"{label}.{name}.rms", rms, rms / (2 * n) ** 0.5, "m", "lower", n)
        yield bias(f"{label}.{name}.bias", off)
        share = float(np.mean(np.abs(off) < NORMAL_95 * deviations[:, k]))
        yield Metric.share(f"{label}.{name}.inside", share, n, "higher")


if __name__ == "__main__":
    main(Config, measure, draw, tables, Config(seeds=2))
