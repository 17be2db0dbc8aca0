"""Where a driver is known to differ from JAX by more than the common bounds.

All were measured; the bounds are about 1.5 times the largest value of the drivers.
"""

__all__ = ["KNOWN_DIFFERENCES", "KnownDifference"]

import dataclasses

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


_NEAR_SURFACE = (
    "The surface is far nearer than the center: its depth is the depth of the ray's "
    "point nearest to the center less half a chord almost as long, and an ulp of the "
    "small rest is a part of an ulp of those two."
)
_NEAR_PLANE = (
    "The surface reaches the plane z = 0 where the rays begin, or almost: its depth "
    "goes to 0, and the ulp with it, but not the rounding of what it is made from."
)
_LARGER_THAN_NEAR = (
    "The surface is far nearer than its primitive is long: its depth is a difference "
    "of lengths that are far larger, and an ulp of the small rest is a part of an ulp "
    "of those."
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
        "perspective/distance 2",
        "depth_relative.p999",
        1.5e-6,
        _NEAR_SURFACE,
        ("llvmpipe",),
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
    KnownDifference(
        "perspective/sphere, distance 1.2", "depth_ulp.p99", 28.0, _NEAR_SURFACE
    ),
    KnownDifference(
        "perspective/sphere, distance 1.2", "depth_relative.p999", 5e-6, _NEAR_SURFACE
    ),
    KnownDifference(
        "perspective/sphere, distance 2",
        "depth_relative.p999",
        1.5e-6,
        _NEAR_SURFACE,
        ("softpipe", "webgl"),
    ),
    KnownDifference(
        "perspective/sphere, reaching behind", "depth_ulp.p99", 12.0, _NEAR_SURFACE
    ),
    KnownDifference(
        "perspective/sphere, reaching behind",
        "depth_relative.p999",
        1.5e-6,
        _NEAR_SURFACE,
    ),
    KnownDifference(
        "perspective/inside a sphere, near its wall",
        "depth_ulp.p99",
        600.0,
        _NEAR_SURFACE,
    ),
    KnownDifference(
        "perspective/inside a sphere, near its wall",
        "depth_relative.p999",
        7e-5,
        _NEAR_SURFACE,
    ),
    KnownDifference(
        "orthographic/sphere, distance 1.01", "depth_ulp.p99", 17.0, _NEAR_PLANE
    ),
    KnownDifference(
        "orthographic/sphere, distance 1.01", "depth_relative.p999", 4.5e-6, _NEAR_PLANE
    ),
    KnownDifference(
        "orthographic/sphere, distance 1.05", "depth_ulp.p99", 14.0, _NEAR_PLANE
    ),
    KnownDifference(
        "orthographic/sphere, distance 1.05", "depth_relative.p999", 3e-6, _NEAR_PLANE
    ),
    KnownDifference(
        "orthographic/sphere, distance 1.2", "depth_ulp.p99", 12.0, _NEAR_PLANE
    ),
    KnownDifference(
        "orthographic/sphere, distance 1.2", "depth_relative.p999", 2.5e-6, _NEAR_PLANE
    ),
    KnownDifference(
        "orthographic/sphere, reaching behind", "depth_ulp.p99", 260.0, _NEAR_PLANE
    ),
    KnownDifference(
        "orthographic/sphere, reaching behind",
        "depth_relative.p999",
        1.6e-3,
        _NEAR_PLANE,
    ),
    KnownDifference(
        "orthographic/inside a sphere", "depth_ulp.p99", 180.0, _NEAR_PLANE
    ),
    KnownDifference(
        "orthographic/inside a sphere", "depth_relative.p999", 1e-4, _NEAR_PLANE
    ),
    KnownDifference(
        "orthographic/inside a sphere, near its wall",
        "depth_ulp.p99",
        190.0,
        _NEAR_PLANE,
    ),
    KnownDifference(
        "orthographic/inside a sphere, near its wall",
        "depth_relative.p999",
        4.5e-4,
        _NEAR_PLANE,
    ),
    KnownDifference(
        "perspective/frustum, reaching behind", "depth_ulp.p99", 14.0, _LARGER_THAN_NEAR
    ),
    KnownDifference(
        "perspective/frustum, reaching behind",
        "depth_relative.p999",
        3.6e-6,
        _LARGER_THAN_NEAR,
    ),
    KnownDifference(
        "perspective/inside a frustum", "depth_ulp.p99", 7.5, _LARGER_THAN_NEAR
    ),
    KnownDifference(
        "perspective/box, reaching behind", "depth_ulp.p99", 11.0, _LARGER_THAN_NEAR
    ),
    KnownDifference(
        "orthographic/frustum, reaching behind", "depth_ulp.p99", 240.0, _NEAR_PLANE
    ),
    KnownDifference(
        "orthographic/frustum, reaching behind",
        "depth_relative.p999",
        3.3e-4,
        _NEAR_PLANE,
    ),
    KnownDifference(
        "orthographic/inside a frustum", "depth_ulp.p99", 70.0, _NEAR_PLANE
    ),
    KnownDifference(
        "orthographic/inside a frustum", "depth_relative.p999", 3.4e-5, _NEAR_PLANE
    ),
    KnownDifference(
        "orthographic/box, reaching behind", "depth_ulp.p99", 165.0, _NEAR_PLANE
    ),
    KnownDifference(
        "orthographic/box, reaching behind", "depth_relative.p999", 1.3e-4, _NEAR_PLANE
    ),
    KnownDifference("orthographic/inside a box", "depth_ulp.p99", 190.0, _NEAR_PLANE),
    KnownDifference(
        "orthographic/inside a box", "depth_relative.p999", 1.2e-4, _NEAR_PLANE
    ),
    KnownDifference(
        "perspective/heightfield, among its peaks",
        "depth_ulp.p99",
        125.0,
        _LARGER_THAN_NEAR,
    ),
    KnownDifference(
        "perspective/heightfield, among its peaks",
        "depth_relative.p999",
        1.1e-5,
        _LARGER_THAN_NEAR,
    ),
    KnownDifference(
        "perspective/bicubic heightfield, among its peaks",
        "depth_ulp.p99",
        165.0,
        _LARGER_THAN_NEAR,
    ),
    KnownDifference(
        "perspective/bicubic heightfield, among its peaks",
        "depth_relative.p999",
        1.4e-5,
        _LARGER_THAN_NEAR,
    ),
    KnownDifference(
        "orthographic/heightfield, reaching behind",
        "depth_ulp.p99",
        210.0,
        _NEAR_PLANE,
    ),
    KnownDifference(
        "orthographic/heightfield, reaching behind",
        "depth_relative.p999",
        1e-4,
        _NEAR_PLANE,
    ),
    KnownDifference(
        "orthographic/heightfield, reaching behind, from below",
        "depth_ulp.p99",
        350.0,
        _NEAR_PLANE,
    ),
    KnownDifference(
        "orthographic/heightfield, reaching behind, from below",
        "depth_relative.p999",
        2.5e-4,
        _NEAR_PLANE,
    ),
    KnownDifference(
        "orthographic/heightfield, among its peaks",
        "depth_ulp.p99",
        320.0,
        _NEAR_PLANE,
    ),
    KnownDifference(
        "orthographic/heightfield, among its peaks",
        "depth_relative.p999",
        4.3e-4,
        _NEAR_PLANE,
    ),
    KnownDifference(
        "orthographic/bicubic heightfield, among its peaks",
        "depth_ulp.p99",
        310.0,
        _NEAR_PLANE,
    ),
    KnownDifference(
        "orthographic/bicubic heightfield, among its peaks",
        "depth_relative.p999",
        1.3e-4,
        _NEAR_PLANE,
    ),
)
