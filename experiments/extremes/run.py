"""Measure how exact the cylinder is at the extremes, beside other formulas."""

__all__ = ["Config", "measure"]

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float

from experiments.extremes.peers import FORMULAS
from experiments.extremes.rays import EXTREMES, at_incidence, at_tilt, over_the_image
from experiments.extremes.report import PERCENTS, draw, tables
from experiments.oracle.claims import DECISION, Errors, errors_of
from experiments.oracle.condition import Reference, reference
from experiments.oracle.extremes import Rays, extreme_rays
from experiments.recording import Metric
from experiments.running import RunConfig, main
from experiments.timing import percentiles
from impostor_jax.numerics import eps

CHUNK = 50_000

DISTANCES = (1 + 1e-6, 1 + 1e-3, 1.1, 2.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6)
"""In radii."""

GRAZING = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.5, 1.0, 1.57)
"""Angle between ray and wall, in radians."""

HEIGHTS = (1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 1e2, 1e3, 1e4)
"""In radii."""

TILTS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.5, 1.0, 1.57)
"""Angle between ray and axis, in radians."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Errors in ulps over all extremes, and beside other formulas."""

    run: RunConfig = RunConfig()
    rays: int = 1_000_000
    """Rays over all extremes together, cast by ours."""
    each: int = 300
    """Rays of every other case, cast by all."""
    seed: int = 0
    """Of all draws."""
    stride: int = 1
    """Of the steps along the two planes of extremes, which are taken."""


def measure(config: Config) -> Iterator[Metric]:
    """Cast and compare."""
    yield from all_together(config.rays, config.seed)
    yield from maps(config.each, config.seed, config.stride)
    yield from side_by_side(10 * config.each, config.seed)
    yield from table(config.each, config.seed)


def all_together(count: int, seed: int) -> Iterator[Metric]:
    """What the cylinder promises, on rays that meet all extremes together."""
    parts = []
    for number, start in enumerate(range(0, count, CHUNK)):
        rays = extreme_rays(min(CHUNK, count - start), seed + number, "float32")
        parts.append(errors_of(rays))
    names = [field.name for field in dataclasses.fields(Errors)]
    found = {name: np.concatenate([getattr(p, name) for p in parts]) for name in names}

    def metric(name: str, value: float, unit: str, n: int) -> Metric:
        better = "higher" if "within" in name else "lower"
        return Metric(f"all.{name}", value, None, unit, better, n)

    bad = int(found["not_finite"].sum())
    yield metric("not_finite", bad, "rays", count)
    for name in ("depth", "depth_ulps", "gradient", "gradient_relative"):
        yield from percentiles(f"all.{name}", found[name], PERCENTS, "eps")
    for name, bound in (("depth", 8), ("gradient", 16)):
        share = float(np.mean(found[name] <= bound))
        yield metric(f"{name}.within_{bound}", share, "part", len(found[name]))
    for name in ("wrong_hit", "wrong_surface"):
        values = found[name]
        worst = float(values.max()) if len(values) else 0.0
        yield metric(f"{name}.margin", worst, "eps", len(values))


def maps(each: int, seed: int, stride: int) -> Iterator[Metric]:
    """Median error of each formula in ulps over the two planes of extremes."""
    rng = np.random.default_rng(seed)
    for distance in DISTANCES[::stride]:
        for grazing in GRAZING[::stride]:
            rays = at_incidence(rng, each, distance, grazing)
            yield from _medians(f"incidence.{distance:.7g}_{grazing:g}", rays)
    for height in HEIGHTS[::stride]:
        for tilt in TILTS[::stride]:
            rays = at_tilt(rng, each, height, tilt, 100 * max(1.0, height))
            yield from _medians(f"tilt.{height:g}_{tilt:g}", rays)


def side_by_side(each: int, seed: int) -> Iterator[Metric]:
    """The 99th percentile on the same rays, as pixels see a cylinder."""
    rng = np.random.default_rng(seed)
    for distance in (10.0, 1e2, 1e3, 1e4, 1e5, 1e6):
        rays = over_the_image(rng, each, distance)
        exact = reference(rays)
        sure = exact.hit_margin > DECISION * eps("float32")
        for name in ("textbook", "published", "ours"):
            t, _ = FORMULAS[name](rays)
            found = _ulps(t, exact)[sure & np.isfinite(exact.t)]
            yield from percentiles(f"image.{distance:g}.{name}", found, [99], "ulp")


def table(each: int, seed: int) -> Iterator[Metric]:
    """Share of the rays that each formula gets wrong, and of derivatives it loses."""
    rng = np.random.default_rng(seed)
    for extreme, (_, draw_rays) in EXTREMES.items():
        rays = draw_rays(rng, each)
        exact = reference(rays)
        for name in FORMULAS:
            t, slope = FORMULAS[name](rays)
            wrong = float(np.mean(_is_wrong(t, rays, exact)))
            label = f"table.{extreme}.{name}"
            yield Metric(f"{label}.wrong", wrong, None, "part", "lower", each)
            if name != "mitsuba":
                lost = float(np.mean(~np.isfinite(slope)))
                yield Metric(f"{label}.no_slope", lost, None, "part", "lower", each)


def _medians(case: str, rays: Rays) -> Iterator[Metric]:
    exact = reference(rays)
    hit = np.isfinite(exact.t) & (exact.hit_margin > DECISION * eps("float32"))
    for name in FORMULAS:
        count = int(hit.sum())
        value = None
        if count:
            value = float(np.median(_ulps(FORMULAS[name](rays)[0], exact)[hit]))
        yield Metric(f"{case}.{name}", value, None, "ulp", "lower", count)


def _ulps(t: Float[np.ndarray, " n"], exact: Reference) -> Float[np.ndarray, " n"]:
    """Error in ulps of the depth; a miss is as wrong as a depth of zero."""
    found = np.where(np.isfinite(t), t, 0)
    true = np.where(np.isfinite(exact.t), exact.t, 1)
    return np.abs(found - true) / np.spacing(true.astype(np.float32)).astype(float)


def _is_wrong(
    t: Float[np.ndarray, " n"], rays: Rays, exact: Reference
) -> Bool[np.ndarray, " n"]:
    """Hit or miss though sure, or depth off by 1 % of the radius and 4 ulps."""
    ulp, hit = eps("float32"), np.isfinite(exact.t)
    sure = exact.hit_margin > DECISION * ulp
    both = hit & np.isfinite(t)
    reach = np.where(both, np.abs(np.where(both, t, 0) - np.where(hit, exact.t, 0)), 0)
    length = np.linalg.norm(rays.direction.astype(float), axis=1)
    allowed = 0.01 * rays.radius + 4 * ulp * np.where(hit, exact.t, 0) * length
    told = both & (exact.surface_margin > DECISION * ulp)
    return (sure & (hit != np.isfinite(t))) | (told & (reach * length > allowed))


if __name__ == "__main__":
    main(Config, measure, tables, Config(rays=2000, each=20, stride=4), draw)
