"""How far a driver may differ from JAX."""

__all__ = ["BOUNDS", "Verdict", "judge"]

import dataclasses

from impostor_jax.parity.compare import Comparison, Spread

BOUNDS = {
    "flips_off_band": 0.0,
    "flips_on_band": 0.02,
    "part_flips": 0.02,
    "depth.p99": 2.0,
    "depth.worst": 3.0,
    "normal.worst": 6.0,
    "normal_deg.p999": 0.02,
}
"""Flips on the band, and of parts, are over the pixels of the band. Depth and normal
are in eps times the condition number: two sides that each round well are a few of these
apart, at any pixel. Of 170 cases with llvmpipe, softpipe and SwiftShader the largest
are 1.5 of depth at the 99th percentile, 2.1 at the worst pixel, and 3.9 of normals."""


@dataclasses.dataclass(frozen=True)
class Verdict:
    """One measured quantity beside its bound."""

    quantity: str
    value: float
    bound: float

    @property
    def holds(self) -> bool:
        """Whether the value is within the bound."""
        return self.value <= self.bound


def judge(found: Comparison, depth: Spread, normal: Spread) -> list[Verdict]:
    """Compare what was measured of a case with the bounds.

    Args:
        found: The differences.
        depth: Those of depth, in eps times the condition number.
        normal: Those of the normal.
    """
    band = max(found.num_band, 1)
    values = {
        "flips_off_band": float(found.flips_off_band),
        "flips_on_band": found.flips_on_band / band,
        "part_flips": found.part_flips / band,
        "depth.p99": depth.p99,
        "depth.worst": depth.worst,
        "normal.worst": normal.worst,
        "normal_deg.p999": found.normal_deg.p999,
    }
    return [Verdict(name, value, BOUNDS[name]) for name, value in values.items()]
