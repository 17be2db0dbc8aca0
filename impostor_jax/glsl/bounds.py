"""How far a driver may differ from JAX, and where it is known to differ more."""

__all__ = ["KNOWN_DIFFERENCES", "KnownDifference", "Verdict", "judge"]

import dataclasses

from impostor_jax.glsl.cases import Case
from impostor_jax.glsl.compare import Comparison

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

SOFTWARE = ("llvmpipe", "softpipe", "webgl")
"""Implementations that were measured."""


@dataclasses.dataclass(frozen=True)
class KnownDifference:
    """A case that exceeds the common bounds.

    Attributes:
        case: Its name.
        quantity: What is larger.
        bound: How large it may be.
        cause: Why it is so.
        drivers: What draws it so.
    """

    case: str
    quantity: str
    bound: float
    cause: str
    drivers: tuple[str, ...] = SOFTWARE


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


_NEAR_SURFACE = (
    "The surface is far nearer than the center: its depth is the depth of the ray's "
    "point nearest to the center less half a chord almost as long, and an ulp of the "
    "small rest is a part of an ulp of those two."
)
_NEAR_PLANE = (
    "The surface reaches the plane z = 0 where the rays begin, or almost: its depth "
    "goes to 0, and the ulp with it, but not the rounding of what it is made from."
)
_GRAZING = (
    "The wall leans 1e-3 rad from the rays: its depth changes a thousand times as fast "
    "as the center, axis and radius that each side rounds in its own way."
)
_FEW_PIXELS = (
    "The wall is 2 pixels wide and 63 are hit, so that the percentile is the worst "
    "pixel, which grazes the wall."
)

KNOWN_DIFFERENCES = (
    KnownDifference(
        "perspective/disc, edge on",
        "depth_ulp.p99",
        6.0,
        _FEW_PIXELS,
        ("llvmpipe",),
    ),
    KnownDifference("perspective/distance 1.2", "depth_ulp.p99", 25.0, _NEAR_SURFACE),
    KnownDifference(
        "perspective/distance 1.2", "depth_relative.p999", 5e-6, _NEAR_SURFACE
    ),
    KnownDifference(
        "perspective/near, reaching behind", "depth_ulp.p99", 12.0, _NEAR_SURFACE
    ),
    KnownDifference(
        "perspective/near, reaching behind", "depth_relative.p999", 4e-6, _NEAR_SURFACE
    ),
    KnownDifference(
        "perspective/between the cap planes", "depth_ulp.p99", 12.0, _NEAR_SURFACE
    ),
    KnownDifference(
        "perspective/between the cap planes", "depth_relative.p999", 4e-6, _NEAR_SURFACE
    ),
    KnownDifference("orthographic/distance 1.01", "depth_ulp.p99", 40.0, _NEAR_PLANE),
    KnownDifference(
        "orthographic/distance 1.01", "depth_relative.p999", 1e-5, _NEAR_PLANE
    ),
    KnownDifference("orthographic/distance 1.05", "depth_ulp.p99", 20.0, _NEAR_PLANE),
    KnownDifference(
        "orthographic/distance 1.05", "depth_relative.p999", 3e-6, _NEAR_PLANE
    ),
    KnownDifference("orthographic/distance 1.2", "depth_ulp.p99", 10.0, _NEAR_PLANE),
    KnownDifference(
        "orthographic/distance 1.2", "depth_relative.p999", 2e-6, _NEAR_PLANE
    ),
    KnownDifference(
        "orthographic/between the cap planes", "depth_ulp.p99", 8.0, _NEAR_SURFACE
    ),
    KnownDifference(
        "orthographic/nearly along", "depth_relative.p999", 1.5e-5, _GRAZING
    ),
    KnownDifference("orthographic/rod, nearly along", "depth_ulp.p99", 40.0, _GRAZING),
    KnownDifference(
        "orthographic/rod, nearly along", "depth_relative.p999", 1.5e-5, _GRAZING
    ),
    KnownDifference(
        "orthographic/near, reaching behind", "depth_ulp.p99", 100.0, _NEAR_PLANE
    ),
    KnownDifference(
        "orthographic/near, reaching behind", "depth_relative.p999", 1e-4, _NEAR_PLANE
    ),
    KnownDifference("orthographic/inside", "depth_ulp.p99", 200.0, _NEAR_PLANE),
    KnownDifference("orthographic/inside", "depth_relative.p999", 1e-4, _NEAR_PLANE),
    KnownDifference(
        "orthographic/inside, oblique", "depth_ulp.p99", 160.0, _NEAR_PLANE
    ),
    KnownDifference(
        "orthographic/inside, oblique", "depth_relative.p999", 1e-4, _NEAR_PLANE
    ),
)


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
        "cap_flips": (found.cap_flips / band, FLIPS_ON_BAND),
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
