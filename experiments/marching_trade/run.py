"""Measure what marching costs and misses, and that the safe setting misses nothing."""

__all__ = ["Config", "measure"]

import dataclasses
import itertools
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from experiments.marching_trade.march import (
    MARCHES,
    March,
    difference_normal,
    march,
)
from experiments.marching_trade.report import draw, tables
from experiments.marching_trade.scenes import (
    EXTENT,
    TERRAINS,
    Rays,
    as_rays,
    land,
    over_land,
)
from experiments.oracle import heightfield as oracle
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.timing import percentiles
from impostor_jax.geometry.rays import Hit, Ray
from impostor_jax.numerics import eps
from impostor_jax.primitives.heightfield import Heightfield

FACTORS = (0.1, 0.2, 0.4, 0.8)
STEPS = (16, 64, 256, 1024)

PATIENT = {
    "fixed": March(steps=1024),
    "proportional": March(steps=1024, threshold=0.001, proportional=True),
    "secant": March(steps=1024, threshold=0.001, proportional=True, secant=True),
    "fixed_secant": March(steps=1024, secant=True),
}
"""Refinements, with as many steps as they want."""

ASTRAY = 0.5
"""Meters behind the first crossing: the march has come out of another fold."""

Depths = Float[np.ndarray, " n"]
Cast = Callable[[Ray], Any]
"""Ray parameters of the first hits."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Marches over two terrains, and checks of the safe setting."""

    run: RunConfig = RunConfig()
    rays: int = 3000
    """Rays over each terrain."""
    checked: int = 100_000
    """Rays at a steep grid, for the safe setting."""
    samples: int = 513
    """Of the terrain along each side, where it is made a grid."""
    seed: int = 0
    """Of all draws."""


def measure(config: Config) -> Iterator[Metric]:
    """March and check."""
    yield from never_missed(config)
    for name in ("smooth",) if config.run.quick else TERRAINS:
        yield from marched(name, config)


def never_missed(config: Config) -> Iterator[Metric]:
    """The safe setting on a grid of slopes up to 88 degrees, against all its cells."""
    rng = np.random.default_rng(config.seed)
    extent = ((-1.0, 1.0), (-1.0, 1.0))
    grid = rng.normal(size=(17, 17)).astype(np.float32).astype(float)
    pair = oracle.random_rays(rng, config.checked, extent, -3.0, 3.0)
    rays = Rays(*(v.astype(np.float32).astype(float) for v in pair))
    true = oracle.first_in_cells(grid, extent, rays.origin, rays.direction)
    height = oracle.heights(grid, extent, "bilinear")
    slant = oracle.slant(height, rays.origin, rays.direction, true)
    for dtype in ("float64",) if config.run.quick else ("float32", "float64"):
        with jax.enable_x64(dtype == "float64"):
            field = Heightfield(jnp.asarray(grid, dtype), jnp.asarray(extent, dtype))
            t = np.asarray(field.intersect(as_rays(rays, dtype)).t, float)
        label, count = f"safe.{dtype}", config.checked
        both = np.isfinite(t) & np.isfinite(true)
        error = np.abs(t[both] - true[both])
        relative = error / true[both]
        reach = (np.linalg.norm(rays.origin, axis=1) + np.abs(grid).max())[both]
        rounding = error * slant[both] / (eps(dtype) * (reach + true[both]))
        # Another crossing than the first is far beyond what rounding does.
        wrong = int(np.sum(np.isfinite(t) != np.isfinite(true)) + np.sum(rounding > 8))
        n = len(error)
        yield Metric(f"{label}.wrong", wrong, None, "rays", "lower", count)
        yield Metric(
            f"{label}.relative.worst", float(relative.max()), None, "1", "lower", n
        )
        within = float(np.mean(relative <= 1e-5))
        yield Metric(f"{label}.within_1e-5", within, None, "part", "higher", n)
        yield Metric(
            f"{label}.rounding.worst", float(rounding.max()), None, "eps", "lower", n
        )
    if not config.run.quick:
        yield from derivatives(grid, extent, rays, slant)


def derivatives(grid: Any, extent: Any, rays: Rays, slant: Depths) -> Iterator[Metric]:
    """Derivative in grid, extent and ray, along one direction, by differences."""
    rng = np.random.default_rng(1)
    with jax.enable_x64(True):
        pair = (Heightfield(grid, extent), as_rays(rays, "float64"))
        tangents = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), pair)

        @jax.jit
        def depth(pair: tuple[Heightfield, Ray]) -> Any:
            return pair[0].intersect(pair[1]).t

        def difference(step: float) -> Depths:
            def moved(by: float) -> Depths:
                shifted = jax.tree.map(lambda x, t: x + by * t, pair, tangents)
                return np.asarray(depth(shifted))

            ahead, behind = moved(step), moved(-step)
            with np.errstate(invalid="ignore"):
                return (ahead - behind) / (2 * step)

        _, found = jax.jvp(depth, (pair,), (tangents,))
        once, twice = difference(1e-7), difference(2e-7)
    found = np.asarray(found)
    size = 1 + np.abs(found)
    seen = np.isfinite(once) & np.isfinite(twice) & (found != 0) & (slant > 0.05)
    # Two steps that disagree span a crest or a crease, where nothing is smooth.
    smooth = seen & (np.abs(once - twice) < 1e-5 * size)
    worst = float(np.max(np.abs(found - once)[smooth] / size[smooth]))
    n = int(smooth.sum())
    yield Metric("derivative.worst", worst, None, "1", "lower", n)
    spans = float(1 - n / seen.sum())
    yield Metric("derivative.not_smooth", spans, None, "part", "lower", int(seen.sum()))


def marched(name: str, config: Config) -> Iterator[Metric]:
    """Every setting on one terrain, beside the root in double precision."""
    rng = np.random.default_rng(config.seed)
    rays = over_land(rng, config.rays)
    terrain = TERRAINS[name]
    bounds = {"lipschitz": terrain.lipschitz, "curvature": terrain.curvature}
    with jax.enable_x64(True):
        field = land(name, "float64", **bounds)
        true = np.asarray(field.intersect(as_rays(rays, "float64")).t)
    yield from reference(name, rays, true)

    only_slope = land(name, "float32", lipschitz=terrain.lipschitz)
    marches = {
        f"march.{factor:g}_{steps}": March(factor=factor, steps=steps)
        for factor, steps in itertools.product(FACTORS, STEPS)
    }
    marches |= {f"published.{k}": v for k, v in MARCHES.items()}
    marches |= {f"patient.{k}": v for k, v in PATIENT.items()}
    casts: dict[str, Cast] = {
        k: partial(march, only_slope, settings=v) for k, v in marches.items()
    }
    casts["safe.slope"] = _safe(only_slope)
    casts["safe.curvature"] = _safe(land(name, "float32", **bounds))
    if config.run.quick:
        casts = {k: v for k, v in casts.items() if k in ("march.0.2_64",)}
    for setting, cast in casts.items():
        yield from compared(f"{name}.{setting}", cast, rays, true)
    if not config.run.quick:
        x, z = (np.linspace(*ends, config.samples) for ends in EXTENT)
        grid = terrain(*jnp.meshgrid(jnp.asarray(x), jnp.asarray(z), indexing="ij"))
        field = Heightfield(grid, EXTENT, "bicubic")
        yield from compared(f"{name}.safe.grid", _safe(field), rays, true)
        yield from normals(name, rays, true)


def _safe(field: Heightfield) -> Cast:
    """The package's own way."""
    return lambda ray: field.intersect(ray).t


def reference(name: str, rays: Rays, true: Depths) -> Iterator[Metric]:
    """That no sample of the gap changes sign before the reference, on some rays."""

    def height(x: Any, z: Any) -> Any:
        return oracle.terrain(x, z, octaves=TERRAINS[name].octaves)

    part = slice(0, 500)
    sampled = oracle.first_in_samples(
        height, EXTENT, rays.origin[part], rays.direction[part], 4000
    )
    late = int(np.sum(sampled < true[part] - 1e-9))
    yield Metric(f"{name}.reference.late", late, None, "rays", "lower", len(sampled))
    hit = np.isfinite(true)
    point = (rays.origin + np.where(hit, true, 0)[:, None] * rays.direction)[hit]
    gap = float(np.max(np.abs(point[:, 1] - height(point[:, 0], point[:, 2]))))
    yield Metric(f"{name}.reference.gap", gap, None, "m", "lower", int(hit.sum()))


def compared(label: str, cast: Cast, rays: Rays, true: Depths) -> Iterator[Metric]:
    """Depth error, part of the surface missed, and time of one setting."""
    ray = as_rays(rays, "float32")
    t = np.asarray(cast(ray), float)
    times = []
    for _ in range(3):
        started = time.perf_counter()
        jax.block_until_ready(cast(ray))
        times.append(time.perf_counter() - started)
    hit = np.isfinite(true)
    lost = hit & ~np.isfinite(t)
    astray = hit & np.isfinite(t) & (np.where(lost, 0, t) > true + ASTRAY)
    near = hit & ~lost & ~astray
    error = np.abs(t[near] - true[near])
    n = int(hit.sum())
    for name, found in (("lost", lost), ("astray", astray)):
        value = float(found.sum() / n)
        yield Metric(f"{label}.{name}", value, None, "part", "lower", n)
    yield from percentiles(f"{label}.error", error, (50, 99), "m")
    each = 1e6 * min(times) / len(t)
    spread = 1e6 * (max(times) - min(times)) / len(t)
    yield Metric(f"{label}.time", each, spread, "us", "lower", len(times))


def normals(name: str, rays: Rays, true: Depths) -> Iterator[Metric]:
    """Angle between the normal by differences and the analytic one, at the root."""
    with jax.enable_x64(True):
        lipschitz = TERRAINS[name].lipschitz
        field = land(name, "float64", lipschitz=lipschitz)
        cast = as_rays(rays, "float64")
        hit = Hit.on_one_piece(jnp.asarray(true))
        exact = field.normal(cast, hit)
        for label, epsilon in (("fixed", 0.02), ("proportional", 0.001 * hit.t)):
            other = difference_normal(field, cast, hit, epsilon)
            sine = np.asarray(exact.cross(other).norm())[np.isfinite(true)]
            angle = float(np.degrees(np.median(np.arcsin(np.minimum(sine, 1)))))
            yield Metric(
                f"{name}.normal.{label}", angle, None, "deg", "lower", len(sine)
            )


if __name__ == "__main__":
    main(Config, measure, tables, Config(rays=50, checked=500, samples=33), draw)
