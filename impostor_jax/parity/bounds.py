"""How far a driver may differ from JAX."""

__all__ = ["Verdict", "judge"]

import dataclasses

from impostor_jax.parity.case import Case
from impostor_jax.parity.compare import Comparison
from impostor_jax.parity.known_differences import KNOWN_DIFFERENCES

FLIPS_ON_BAND = 0.02
"""Part of the pixels at an edge that may see something else."""

DEPTH_ULP = 4.0
"""99th percentile of the difference in depth."""

DEPTH_RELATIVE = 1e-6
"""Its 99.9th percentile, as a part of the depth."""

NORMAL_DEG = 0.02
"""99.9th percentile of the angle between the normals."""

NEAR = 1.2
"""Distance over radius below which depth errs with the inverse of the clearance."""


@dataclasses.dataclass(frozen=True)
class Verdict:
    """One measured quantity beside its bound.

    Attributes:
        quantity: Its name.
        value: What was measured.
        bound: How large it may be.
        cause: Of the known difference that allows it, "" where the common bound holds.
    """

    quantity: str
    value: float
    bound: float
    cause: str

    @property
    def holds(self) -> bool:
        """Whether the value is within the bound."""
        return self.value <= self.bound


def judge(case: Case, found: Comparison, driver: str) -> list[Verdict]:
    """Compare what was measured of a case with its bounds.

    Args:
        case: The case.
        found: What was measured.
        driver: What drew it; a graphics card has no known differences.
    """
    clearance = case.distance_over_radius - 1
    # Parallel rays come from no place that could be near.
    is_near = case.camera.is_central and 0 < clearance < NEAR - 1
    band = max(found.num_band, 1)
    values = {
        "flips_off_band": (float(found.flips_off_band), 0.0),
        "flips_on_band": (found.flips_on_band / band, FLIPS_ON_BAND),
        "part_flips": (found.part_flips / band, FLIPS_ON_BAND),
        "depth_ulp.p99": (
            found.depth_ulp.p99,
            DEPTH_ULP / clearance if is_near else DEPTH_ULP,
        ),
        "normal_deg.p999": (found.normal_deg.p999, NORMAL_DEG),
    }
    if not is_near:
        values["depth_relative.p999"] = (found.depth_relative.p999, DEPTH_RELATIVE)
    verdicts = []
    for quantity, (value, bound) in values.items():
        cause = ""
        for known in KNOWN_DIFFERENCES:
            applies = (known.case, known.quantity) == (case.name, quantity)
            if applies and value > bound and driver in known.drivers:
                bound, cause = known.bound, known.cause
                break
        verdicts.append(Verdict(quantity, value, bound, cause))
    return verdicts
