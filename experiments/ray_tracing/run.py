"""Trace the published scene, rays that start at surfaces, and rays at many shapes."""

__all__ = ["Config", "measure"]

import dataclasses
import itertools
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from skimage.metrics import structural_similarity

import impostor_jax as ij
from experiments.oracle import whitted
from experiments.ray_tracing import edges
from experiments.ray_tracing.own_hits import OFFSETS, SHAPES, hits_again
from experiments.ray_tracing.peers import (
    drawn_by_mitsuba,
    hits_by_mitsuba,
    hits_by_open3d,
    picture_by_mitsuba,
)
from experiments.ray_tracing.report import tables
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.timing import percentiles, sample, time_in_turns
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.parity.traced_cases import traced

SAMPLINGS = {
    "1 ray": ij.Effort(),
    "4x4": ij.Effort(samples=4, adaptive=False),
    "4x4 where trails differ": ij.Effort(samples=4),
    "3x3 where trails differ": ij.Effort(samples=3),
    "2x2 where trails differ": ij.Effort(samples=2),
    "every 2nd, mean of one trail": ij.Effort(spacing=2),
    "every 4th, mean of one trail": ij.Effort(spacing=4),
}
"""Which rays are cast, by the names of the table."""

EDGES: dict[str, dict[str, Any]] = {
    "hard": {},
    "area": {"edges": "area"},
    "area, 2x2": {"edges": "area", "effort": ij.Effort(samples=2)},
    "hard, 2x2": {"effort": ij.Effort(samples=2, adaptive=False)},
    "hard, 4x4": {"effort": ij.Effort(samples=4, adaptive=False)},
}
"""How edges are drawn, by the names of the table."""

STEP = 5e-4
"""Of differences, in meters: a fortieth of a pixel. Of 2 mm they err by 1 %."""

REFERENCE = 16
"""Rays along each side of a pixel of the picture that others are compared with."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Measure what a traced picture costs, and how far off it is."""

    run: RunConfig = RunConfig()
    rays: int = 1_000_000
    """From surfaces, of each shape, scale and distance; at scenes a third as many."""
    repeats: int = 20
    """Of each timing."""
    width: int = 640
    """Columns of the pictures, for 3 rows of 4."""
    seed: int = 0
    """Of all draws."""


def measure(config: Config) -> Iterator[Metric]:
    """Measure rays at surfaces, pictures, rays at many shapes, and edges."""
    yield from _own_hits(config)
    yield from _published(config)
    yield from _beside_mitsuba(config)
    yield from _incoherent(config)
    yield from _edges(config)


def _own_hits(config: Config) -> Iterator[Metric]:
    rng, quick = np.random.default_rng(config.seed), config.run.quick
    scales = (1.0,) if quick else (1e-6, 1e-3, 1.0, 1e3, 1e6)
    names = SHAPES[:1] if quick else SHAPES
    for distance in (10.0,) if quick else (1.5, 10.0, 100.0, 1e3, 1e4):
        cells = itertools.product(names, scales)
        found = np.array(
            [hits_again(*one, distance, config.rays, rng) for one in cells]
        )
        for number, offset in enumerate(OFFSETS):
            worst = float(found[:, number].max())
            name = f"own.{distance:g}.{offset}"
            yield Metric.share(name, worst, config.rays, "lower")


def _camera(config: Config) -> ij.PinholeCamera:
    width, height = config.width, config.width * 3 // 4
    middle = (width - 1) / 2, (height - 1) / 2
    return ij.PinholeCamera(0.75 * width, 0.75 * width, *middle, width, height)


def _published(config: Config) -> Iterator[Metric]:
    """The published scene: its error, its time and its gradient's."""
    scene, camera = traced("perspective")[0], _camera(config)
    shapes, lights, materials = scene.shapes, list(scene.lights), list(scene.materials)
    world = ij.Scene(shapes)

    def trace(effort: ij.Effort, camera: ij.PinholeCamera = camera):
        return ij.trace(world, camera, lights, materials, effort=effort)

    few = _camera(dataclasses.replace(config, width=160))
    exact = whitted.picture(shapes, few, lights, materials)
    inner = whitted.off_edges(few, shapes, lights, materials)
    for precision in ("float32",) if config.run.quick else ("float32", "float64"):
        picture = trace(ij.Effort(precision=precision), few)
        apart = np.abs(np.asarray(picture, float) - exact.color).max(axis=-1)[inner]
        apart = apart / exact.color.max()
        yield from percentiles(f"error.{precision}", apart, (50, 90, 99), "1")
    quick = config.run.quick
    samplings = dict(list(SAMPLINGS.items())[: 2 if quick else None])
    reference = _reference(trace, camera, 4 if quick else REFERENCE)
    calls: dict[str, Callable[[], object]] = {
        name: partial(trace, effort) for name, effort in samplings.items()
    }
    for name, effort in samplings.items():
        picture = np.asarray(trace(effort), float)
        rmse = float(np.sqrt(np.mean((picture - reference) ** 2)))
        yield Metric(f"sampling.{name}.rmse", rmse, None, "1", "lower", picture.size)
        alike: Any = structural_similarity(
            reference, picture, channel_axis=-1, data_range=float(reference.max())
        )
        yield Metric(
            f"sampling.{name}.ssim", float(alike), None, "1", "higher", picture.size
        )

    @eqx.filter_jit
    @eqx.filter_grad
    def gradient(given):
        world, lights, materials = given
        return jnp.sum(ij.trace(world, camera, lights, materials) ** 2)

    if not quick:
        calls["gradient"] = lambda: gradient((world, lights, materials))
        by_mitsuba = drawn_by_mitsuba(shapes, camera, materials, depth=3)
        calls |= {} if by_mitsuba is None else {"Mitsuba, 1 path": by_mitsuba}
    repeats = 1 if quick else config.repeats
    for name, timing in time_in_turns(calls, repeats, warm_up=1).items():
        yield sample(f"sampling.{name}.time", timing.ms, "ms")


def _reference(trace: Callable, camera: ij.PinholeCamera, side: int) -> np.ndarray:
    """The mean of so many rays along each side of a pixel, by four times four."""
    shifts = jnp.asarray((np.arange(side // 4) - (side // 4 - 1) / 2) / side)
    pictures = [
        np.asarray(
            trace(SAMPLINGS["4x4"], camera.shifted(*map(jnp.asarray, (x, y)))), float
        )
        for x in shifts
        for y in shifts
    ]
    return np.mean(pictures, axis=0)


FLOOR = ij.Box((0.0, 0.55, 2.5), np.eye(3), (4.0, 0.1, 4.0))
LIGHT = ij.PointLight((1.0, -2.0, 1.0), (3.0, 2.5, 2.0), "inverse_square")
DULL = [ij.Material(color) for color in ((0.8, 0.8, 0.7), (0.9, 0.2, 0.1))]
MIRROR = ij.Material(reflect=1.0)


def _beside_mitsuba(config: Config) -> Iterator[Metric]:
    """Pictures of mirrors, and of glass, beside Mitsuba's."""
    can = ij.Cylinder((-0.5, 0.2, 2.6), (0.0, 1.0, 0.0), 0.15, 0.6)
    lying = ij.Cylinder((0.5, 0.3, 2.0), (0.3, 0.2, 1.0), 0.2, 0.5)
    leaning = ij.Cylinder((0.4, 0.2, 2.0), (0.5, 0.6, 0.3), 0.15, 0.6)
    ball, other = ij.Sphere((0.0, 0.25, 2.0), 0.25), ij.Sphere((0.2, -0.3, 2.5), 0.2)
    turned = [[0.96, 0.0, 0.28], [0.0, 1.0, 0.0], [-0.28, 0.0, 0.96]]
    wall = ij.Box((0.0, 0.0, 3.2), turned, (2.0, 1.0, 0.1))
    clear = [ij.Material(transmit=1.0, ior=ior) for ior in (1.5, 1.4)]
    cases = {
        "mirrors": (
            [FLOOR, can, lying, ball, other, wall],
            [*DULL, *DULL, MIRROR, MIRROR],
        ),
        "glass": ([FLOOR, can, other, ball, leaning], [*DULL, DULL[1], *clear]),
    }
    camera = _camera(dataclasses.replace(config, width=min(config.width, 320)))
    for name, (shapes, materials) in cases.items():
        other_one = picture_by_mitsuba(shapes, camera, LIGHT, materials, depth=3)
        if other_one is None:
            return
        picture = np.asarray(ij.trace(ij.Scene(shapes), camera, [LIGHT], materials))
        inner = whitted.off_edges(camera, shapes, [LIGHT], materials)
        exact = whitted.picture(shapes, camera, [LIGHT], materials).color
        for program, found in (("Mitsuba", other_one), ("textbook", exact)):
            apart = np.abs(picture - found).max(axis=-1)[inner] / exact.max()
            label = f"beside.{name}, {program}"
            yield from percentiles(label, apart, (50, 90, 99, 99.9), "1")


def _incoherent(config: Config) -> Iterator[Metric]:
    """Rays of any origin and direction at so many balls, or cans."""
    rng = np.random.default_rng(config.seed)
    count = config.rays * 3 // 10
    origin, direction = rng.uniform(-1, 1, (count, 3)), rng.normal(size=(count, 3))
    ray = Ray(*(Vec3.from_array(jnp.asarray(x)) for x in (origin, direction)))
    first = jax.jit(lambda scene: scene.intersect(ray))
    blocked = jax.jit(lambda scene: scene.occluded(ray))
    for number in (10,) if config.run.quick else (10, 100, 1000, 10_000):
        center = rng.uniform(-1, 1, (number, 3))
        radius = 0.3 / number ** (1 / 3) * rng.uniform(0.5, 1, number)
        axis = rng.normal(size=center.shape)
        batches = {
            "balls": ij.Sphere(center, radius),
            "cans": ij.Cylinder(center, axis, radius / 2, radius),
        }
        calls: dict[str, Callable[[], object]] = {
            f"{name}.{what}.JAX": partial(f, ij.Scene([shapes]))
            for name, shapes in batches.items()
            for what, f in (("first", first), ("blocked", blocked))
        }
        for name, shapes in batches.items():
            others = {"Mitsuba": hits_by_mitsuba(shapes, origin, direction)}
            if isinstance(shapes, ij.Cylinder):
                others["Open3D"] = hits_by_open3d(shapes, origin, direction)
            for program, hits in others.items():
                for what, call in hits.items():
                    calls[f"{name}.{what}.{program}"] = call
        repeats = 1 if config.run.quick else config.repeats
        for name, timing in time_in_turns(calls, repeats, warm_up=1).items():
            yield sample(f"many.{number}.{name}.time", timing.ms, "ms")


def _edges(config: Config) -> Iterator[Metric]:
    """Pictures and gradients of scenes with edges, beside many rays a pixel."""
    quick = config.run.quick
    width, parts = (8, 4) if quick else (64, 64)
    for name in list(edges.SCENES)[: 1 if quick else None]:
        seen = edges.SCENES[name]()
        sides = dict(list(EDGES.items())[: 2 if quick else None])
        reference = edges.supersampled(seen, seen.given, width, parts)
        target = edges.supersampled(seen, seen.target, width, parts)
        slope = _flat(edges.differences(seen, width, target, parts, STEP))
        calls: dict[str, Callable[[], object]] = {}
        for side, options in sides.items():
            call = partial(edges.picture, seen, seen.given, width, **options)
            rmse = float(np.sqrt(np.mean((np.asarray(call()) - reference) ** 2)))
            case, n = f"edges.{name}.{side}", reference.size
            yield Metric(f"{case}.rmse", rmse, None, "1", "lower", n)
            found = _flat(edges.gradient(seen, width, target, **options))
            off = float(np.linalg.norm(found - slope) / np.linalg.norm(slope))
            yield Metric(f"{case}.gradient", off, None, "1", "lower", slope.size)
            calls[side] = partial(
                edges.picture, seen, seen.given, config.width, **options
            )
        repeats = 1 if quick else config.repeats
        for side, timing in time_in_turns(calls, repeats, warm_up=1).items():
            yield sample(f"edges.{name}.{side}.time", timing.ms, "ms")


def _flat(tree: Any) -> np.ndarray:
    return np.concatenate([np.ravel(x) for x in jax.tree.leaves(tree)])


if __name__ == "__main__":
    main(Config, measure, tables, Config(rays=2000, repeats=1, width=32))
