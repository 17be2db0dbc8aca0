"""How far two renderings of one scene differ."""

__all__ = [
    "Comparison",
    "Spread",
    "angles_between",
    "compare",
    "edge_band",
    "rounding",
]

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import maximum_filter, minimum_filter

from impostor_jax.glsl.conventions import DrawnMaps
from impostor_jax.numerics import eps
from impostor_jax.parity.condition import Condition


@dataclasses.dataclass(frozen=True)
class Spread:
    """Median, percentiles and largest of absolute differences; 0 where there are none.

    Attributes:
        median: 50th percentile.
        p99: 99th percentile.
        p999: 99.9th percentile.
        worst: The largest.
    """

    median: float
    p99: float
    p999: float
    worst: float

    @staticmethod
    def of(differences: Float[np.ndarray, " n"]) -> "Spread":
        """Spread of differences that need no sign."""
        if not len(differences):
            return Spread(0.0, 0.0, 0.0, 0.0)
        found = np.percentile(differences, (50, 99, 99.9, 100))
        return Spread(*(float(value) for value in found))


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Differences of a rendering from the reference.

    Attributes:
        num_hits: Pixels where the reference hits something.
        num_band: Pixels of the band.
        flips_on_band: Pixels of the band where another primitive, or none, is seen.
        flips_off_band: The same off the band.
        part_flips: Pixels that see another part of the same primitive, as cap for wall.
        depth_m: Depth, in meters, where both see the same primitive.
        depth_ulp: The same in units of the last place of the reference's depth.
        depth_relative: The same as a part of the reference's depth.
        normal_deg: Angle between the normals there, in degrees.
    """

    num_hits: int
    num_band: int
    flips_on_band: int
    flips_off_band: int
    part_flips: int
    depth_m: Spread
    depth_ulp: Spread
    depth_relative: Spread
    normal_deg: Spread


def edge_band(index: Int[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels within one pixel of an edge between two primitives or the background.

    Args:
        index: Which primitive is seen, -1 for none; or a number of all that is.
    """
    extremes = (of(index, 3, mode="nearest") for of in (minimum_filter, maximum_filter))
    return np.not_equal(*extremes)


def angles_between(
    first: Float[np.ndarray, "n 3"], second: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, " n"]:
    """Angles between unit vectors, in degrees; exact for small ones, too."""
    n, m = first.astype(np.float64), second.astype(np.float64)
    sine = np.linalg.norm(np.cross(n, m), axis=-1)
    return np.degrees(np.arctan2(sine, np.sum(n * m, axis=-1)))


def compare(reference: DrawnMaps, drawn: DrawnMaps) -> Comparison:
    """Compare a driver's rendering with the reference, which may be more precise.

    Returns:
        The differences; those of depth and normal where both see the same primitive.
    """
    band = edge_band(reference.index)
    flips = reference.index != drawn.index
    same = reference.mask & ~flips
    true = reference.depth[same].astype(np.float64)
    apart = np.abs(drawn.depth[same].astype(np.float64) - true)
    ulp = np.spacing(np.abs(true).astype(np.float32)).astype(np.float64)
    angle = angles_between(reference.normal[same], drawn.normal[same])
    return Comparison(
        num_hits=int(np.count_nonzero(reference.mask)),
        num_band=int(np.count_nonzero(band)),
        flips_on_band=int(np.count_nonzero(flips & band)),
        flips_off_band=int(np.count_nonzero(flips & ~band)),
        part_flips=int(np.count_nonzero((reference.part != drawn.part) & same)),
        depth_m=Spread.of(apart),
        depth_ulp=Spread.of(apart / ulp),
        depth_relative=Spread.of(apart / np.abs(true)),
        normal_deg=Spread.of(angle),
    )


def rounding(
    reference: DrawnMaps, drawn: DrawnMaps, condition: Condition
) -> tuple[Spread, Spread]:
    """Differences of depth and normal, over what eps in all inputs does to them."""
    same = reference.mask & (reference.index == drawn.index)
    true = reference.depth[same].astype(np.float64)
    angle = angles_between(reference.normal[same], drawn.normal[same])

    def over(apart: np.ndarray, of_inputs: np.ndarray) -> Spread:
        known_to = eps(reference.depth.dtype) * of_inputs[same].astype(np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            return Spread.of(np.where(apart > 0, apart / known_to, 0.0))

    depth = over(np.abs(drawn.depth[same] - true), condition.depth)
    return depth, over(np.radians(angle), condition.normal)
