"""Fit cans to silhouettes alone, compare with the bound, and fit what is no can."""

__all__ = ["Config", "measure"]

import dataclasses
import time
from collections import Counter
from collections.abc import Callable, Iterator

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import impostor_jax as ij
from experiments.errors import COORDINATES
from experiments.fit_outline.report import TOLD, tables
from experiments.fitting import inside, over_bound, rmse
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.scenes import CAMERA, DISTANCE, HEIGHT, RADIUS, Image
from impostor_jax.evaluate import difference
from impostor_jax.geometry.so3 import tangent_basis

RADIUS_SIGMA = 1e-4
"""Deviation of the radius that is known, in meters."""

NOISE = 0.05
"""Of a matte's coverages."""

GRID = 12**-0.5
"""Deviation of the place of an edge between two centers, in pixels."""

VIEWS = {
    "across": ((85.0, 90.0), (0.0, 2 * np.pi)),
    "60 deg": ((55.0, 65.0), (0.0, 2 * np.pi)),
    "30 deg": ((28.0, 32.0), (0.0, 2 * np.pi)),
    "along the grid": ((90.0, 90.0), (0.0, 0.0)),
}
"""Between the axis and the camera's, and its turn in the image."""

BOUNDED = 10
"""One of so many views whose bound is computed: it hardly differs between them."""

FINE = 8
"""Parts along a pixel's side in which what is no can is drawn."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure the accuracy of fits to silhouettes."""

    run: RunConfig = RunConfig()
    seeds: int = 200
    """Images of each case."""
    others: int = 40
    """Masks of each thing that is no can."""
    seed: int = 0
    """Of all draws."""


def measure(config: Config) -> Iterator[Metric]:
    """Compare fits with the bound, and fit what is no can."""
    some = 1 if config.run.quick else None
    for kind in ("matte", "mask"):
        for view in list(VIEWS)[:some]:
            rng = np.random.default_rng(config.seed)
            yield from compared(kind, view, config.seeds, rng)
        for name in list(OTHERS)[:some]:
            rng = np.random.default_rng(config.seed)
            found = Counter(
                str(_fit(seen(OTHERS[name](rng), kind, rng), RADIUS).status)
                for _ in range(config.others)
            )
            label, n = f"other.{name}, {kind}", config.others
            yield Metric(
                f"{label}.successes", found["converged"], None, "masks", "lower", n
            )
            yield Metric(
                f"{label}.undetermined",
                found["undetermined"] + found["ambiguous"],
                None,
                "masks",
                "lower",
                n,
            )


def compared(
    kind: str, view: str, count: int, rng: np.random.Generator
) -> Iterator[Metric]:
    """Errors over the bound, intervals and failures."""
    label, noise = f"can.{view}, {kind}", NOISE if kind == "matte" else GRID
    errors, deviations, bounds, seconds = [], [], [], []
    for number in range(count):
        can = _draw_can(view, rng)
        mask = seen(np.asarray(ij.coverage(can, CAMERA)), kind, rng)
        if kind == "mask":
            mask = np.asarray(ij.render(can, CAMERA, outputs=("mask",)).mask)
        start = time.perf_counter()
        fit = _fit(mask, rng.normal(RADIUS, RADIUS_SIGMA))
        seconds.append(time.perf_counter() - start)
        if not fit.success:
            continue
        off = difference(fit.shape, can)
        errors.append(_told(off, fit.cylinder))
        deviations.append(_deviations(np.asarray(fit.covariance), fit.cylinder))
        if number % BOUNDED == 0:
            bounds.append(_deviations(_bound(can, noise), can))
    yield Metric(
        f"{label}.failures", count - len(errors), None, "images", "lower", count
    )
    milliseconds = 1e3 * float(np.median(seconds))
    yield Metric(f"{label}.time", milliseconds, None, "ms", "lower", count)
    off, told, least = np.array(errors), np.array(deviations), np.array(bounds)
    for place, (name, unit) in enumerate(TOLD.items()):
        # An axis errs in two directions, and its error is both together.
        own = np.s_[:, :2] if name == "axis" else np.s_[:, place + 1 : place + 2]
        errors_of, bounds_of = (np.linalg.norm(x[own], axis=1) for x in (off, least))
        path, size = f"{label}.{name}", np.degrees(1) if unit == "deg" else 1e3
        yield over_bound(f"{path}.over_bound", errors_of, bounds_of)
        yield rmse(f"{path}.rmse", errors_of, unit, size)
        yield inside(f"{path}.inside", off[own], told[own])


def _fit(mask: Image, radius: float) -> ij.Fit:
    return ij.fit_cylinder(
        None,
        CAMERA,
        mask,
        NOISE if np.issubdtype(mask.dtype, np.floating) else 0.0,
        prior={"radius": (radius, RADIUS_SIGMA)},
        mask_meaning="outline",
    )


def seen(covered: Image, kind: str, rng: np.random.Generator) -> Image:
    """A matte with noise, or a mask, of what covers pixels so far."""
    if kind == "mask":
        return covered >= 0.5
    noisy = covered + rng.normal(0, NOISE, covered.shape)
    return np.clip(noisy, 0, 1).astype(np.float32)


def _draw_can(view: str, rng: np.random.Generator) -> ij.Cylinder:
    degrees, turns = VIEWS[view]
    angle, turn = np.radians(rng.uniform(*degrees)), rng.uniform(*turns)
    center = np.array([0.0, 0.0, DISTANCE]) + rng.uniform(-0.05, 0.05, 3)
    sine = np.sin(angle)
    axis = np.array([sine * np.cos(turn), sine * np.sin(turn), np.cos(angle)])
    return ij.Cylinder(center, axis, RADIUS, HEIGHT)


def _told(off: Float[np.ndarray, "7"], can: ij.Cylinder) -> Float[np.ndarray, "5"]:
    """Of errors in the covariance's coordinates, those of what is told."""
    return _directions(can) @ off


def _deviations(
    covariance: Float[np.ndarray, "7 7"], can: ij.Cylinder
) -> Float[np.ndarray, "5"]:
    """Their standard deviations."""
    told = _directions(can)
    return np.sqrt(np.diagonal(told @ covariance @ told.T))


def _directions(can: ij.Cylinder) -> Float[np.ndarray, "5 7"]:
    """What is told, one a row: the axis twice, across, distance, height.

    Across is the center's place along the direction across both axis and view, distance
    that along the camera's axis.
    """
    axis = np.asarray(can.axis, float)
    axis = axis / np.linalg.norm(axis)
    basis = np.asarray(tangent_basis(jnp.asarray(axis)), float)
    aside = np.cross(axis, np.asarray(can.center, float))
    aside /= np.linalg.norm(aside)
    found = np.zeros((5, 7))
    found[[0, 1, 4], [0, 1, 6]] = 1
    found[2, 2:4] = basis @ aside
    found[3, 2:5] = *basis[:, 2], axis[2]
    return found


def _bound(can: ij.Cylinder, noise: float) -> Float[np.ndarray, "7 7"]:
    """Least covariance of any unbiased estimate from coverages that err so far."""
    with jax.enable_x64(True):
        exact = jax.tree.map(lambda x: jnp.asarray(np.asarray(x), float), can)
        columns = np.asarray(_derivatives(exact)).reshape(-1, 7) / noise
    information = columns.T @ columns
    information[5, 5] += RADIUS_SIGMA**-2
    return np.linalg.inv(information)


@jax.jit
def _derivatives(can: ij.Cylinder) -> Float[Array, "h w 7"]:
    count, moved = COORDINATES[ij.Cylinder]
    return jax.jacfwd(lambda move: ij.coverage(moved(can, move), CAMERA))(
        jnp.zeros(count)
    )


def _ball(rng: np.random.Generator) -> Image:
    center = np.array([0.0, 0.0, DISTANCE]) + rng.uniform(-0.1, 0.1, 3)
    return np.asarray(ij.coverage(ij.Sphere(center, rng.uniform(0.03, 0.08)), CAMERA))


def _box(rng: np.random.Generator) -> Image:
    """A box that is turned anyhow, 4 to 12 cm along its sides."""
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    sides = rng.uniform(0.04, 0.12, 3)
    corners = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T * sides
    points = corners @ turn + np.array([0.0, 0.0, DISTANCE])
    pixels = np.asarray(CAMERA.project(jnp.asarray(points, jnp.float32)))
    return _filled(cv2.convexHull(pixels.astype(np.float32))[:, 0])


def _shaped(corners: Float[np.ndarray, "n 2"]) -> Callable[..., Image]:
    """A polygon, turned, 30 to 80 pixels from its middle to its farthest corner."""

    def draw_one(rng: np.random.Generator) -> Image:
        turn, size = rng.uniform(0, 2 * np.pi), rng.uniform(30, 80)
        cos, sin = np.cos(turn), np.sin(turn)
        placed = size * corners @ np.array([[cos, sin], [-sin, cos]])
        return _filled(placed + np.array([320.0, 240.0]) + rng.uniform(-9, 9, 2))

    return draw_one


def _filled(corners: Float[np.ndarray, "n 2"]) -> Image:
    """Part of each pixel that a polygon covers."""
    shape = CAMERA.height * FINE, CAMERA.width * FINE
    points = np.round((corners + 0.5) * FINE - 0.5).astype(np.int32)
    fine = cv2.fillPoly(np.zeros(shape, np.uint8), [points], 1)
    size = CAMERA.width, CAMERA.height
    return cv2.resize(fine.astype(np.float32), size, interpolation=cv2.INTER_AREA)


def _regular(radii: list[float]) -> Float[np.ndarray, "n 2"]:
    """Corners at equal angles, at these distances in turn."""
    angle = np.arange(len(radii)) * (2 * np.pi / len(radii))
    radius = np.array(radii)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


L_CORNERS = [(-0.5, -0.8), (0, -0.8), (0, 0.3), (0.6, 0.3), (0.6, 0.8), (-0.5, 0.8)]

OTHERS = {
    "an L": _shaped(np.array(L_CORNERS)),
    "a star": _shaped(_regular([1.0, 0.5] * 5)),
    "a triangle": _shaped(_regular([1.0] * 3)),
    "a hexagon": _shaped(_regular([1.0] * 6)),
    "an ellipse, 2:1": _shaped(_regular([1.0] * 180) * np.array([1.0, 0.5])),
    "a ball": _ball,
    "a box": _box,
}
"""Coverages of what is no can."""

if __name__ == "__main__":
    main(Config, measure, tables, Config(seeds=2, others=1))
