"""Fit cans of known size in real depth images, with and without the sensors' bias."""

__all__ = ["Config", "measure"]

import dataclasses
import importlib.util
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import impostor_jax as ij
from experiments.fitting import NORMAL_95
from experiments.real_images.cases import Case, cases_in, drawn_case
from experiments.real_images.report import tables
from experiments.recording import Metric
from experiments.running import RunConfig, main
from impostor_jax.fit.budget import BUDGET


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure how far off fits of real images are."""

    run: RunConfig = RunConfig()
    folder: Path | None = None
    """Folder of the images, which are not part of the project."""


def measure(config: Config) -> Iterator[Metric]:
    """Fit each can by each model, and by other programs."""
    if config.folder is not None:
        yield from _of_folder(config.folder)
        return
    if not config.run.quick:
        raise ValueError("folder must be given, of the images that are fitted")
    with tempfile.TemporaryDirectory() as home:
        drawn_case(Path(home))
        yield from _of_folder(Path(home))


def _of_folder(folder: Path) -> Iterator[Metric]:
    for case in cases_in(folder):
        depth, mask, camera = case.read(folder)
        whole, noise = case.sensors(camera)
        fits = {
            name: ij.fit_cylinder(depth, camera, mask, sensor)
            for name, sensor in {"whole": whole, "noise": noise}.items()
        }
        for name, fit in fits.items():
            yield from _of_fit(f"{case.name}.{name}", case, fit)
        if case.mouth:
            yield from _of_tube(case, depth, case.with_mouth(mask), camera)
        yield from _of_peers(case, depth, mask & (depth > 0), camera, fits["whole"])


def _of_fit(label: str, case: Case, fit: ij.Fit) -> Iterator[Metric]:
    """Error and half the 95 % interval of the radius, and what that is made of."""
    is_right, n = bool(fit.success), int(fit.num_pixels)
    off = 1e3 * (float(fit.cylinder.radius) - case.radius) if is_right else None
    half = 1e3 * NORMAL_95 * float(fit.std.radius) if is_right else None
    yield Metric(f"{label}.error", off, half, "mm", "lower", n)
    if is_right:
        parts = fit.std_budget.of("radius")
        for part in filter(parts.__contains__, BUDGET):
            std = 1e3 * float(parts[part])
            yield Metric(f"{label}.std.{part}", std, None, "mm", "lower", n)


def _of_tube(
    case: Case, depth: np.ndarray, mask: np.ndarray, camera: ij.PinholeCamera
) -> Iterator[Metric]:
    """What the fit of a tube says of a mug, and whether its bore is needed."""
    whole, _ = case.sensors(camera)
    test = ij.test_bore(ij.fit_cylinder(depth, camera, mask, whole))
    fit, n = test.tube, int(test.tube.num_pixels)
    is_right = bool(fit.success)
    for name in ("outer_radius", "inner_radius"):
        value = 1e3 * float(getattr(fit.tube, name)) if is_right else None
        half = 1e3 * NORMAL_95 * float(getattr(fit.std, name)) if is_right else None
        yield Metric(f"{case.name}.tube.{name}", value, half, "mm", "lower", n)
    statistic = float(test.statistic) if is_right else None
    yield Metric(f"{case.name}.tube.statistic", statistic, None, "1", "lower", n)


def _of_peers(
    case: Case, depth: np.ndarray, used: np.ndarray, camera: ij.PinholeCamera,
    fit: ij.Fit,
) -> Iterator[Metric]:  # fmt: skip
    """The radius by other programs, from all points of the mask."""
    if importlib.util.find_spec("cylfit") is None:
        return
    from experiments.fit_accuracy.peers import PEERS, points_of

    points = points_of(depth, used, camera)
    sigma = float(fit.rms)
    for name, peer in PEERS.items():
        *_, radius = peer(points, sigma, fit.cylinder)
        off = 1e3 * (radius - case.radius)
        yield Metric(f"{case.name}.{name}.error", off, None, "mm", "lower", len(points))


if __name__ == "__main__":
    main(Config, measure, tables, Config())
