"""The images that a render returns."""

__all__ = ["MISSES", "OUTPUTS", "GeometryMaps"]

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float, Int

MISSES = {
    "depth": np.inf,
    "range": np.inf,
    "point": np.inf,
    "normal": 0.0,
    "mask": False,
    "index": -1,
    "part": -1,
    "coverage": 0.0,
    "share": 1.0,
    "beside": np.inf,
}
"""What each map holds where nothing is hit."""

OUTPUTS = tuple(MISSES)


class GeometryMaps(eqx.Module):
    """Geometry seen by each pixel, in the camera frame; None where not asked for.

    Attributes:
        depth: z of the surface point in meters, or its range if the camera is a
            `SphericalCamera`; `+inf` where nothing is hit.
        range: Distance along the ray in meters; `+inf` where nothing is hit.
        point: Surface point in meters; `+inf` where nothing is hit.
        normal: Unit normal that faces the camera; zero where nothing is hit.
        mask: Whether the pixel's center ray hits anything.
        index: Which shape of a scene is hit, counted from 0; -1 where none is.
        part: Which piece of its surface, -1 where nothing is hit: of a cylinder or a
            frustum 0 for the wall, then caps and cut faces; of a box the face, 0 to 5.
        coverage: Part of the pixel that is covered, in [0, 1], or a sample of it.
        share: Part of the pixel that what its center sees covers, be it nothing, from
            1/2 to 1; the rest is beyond an edge. It has a derivative where edges move.
        beside: Depth of that rest, at its middle; `+inf` where nothing is hit there, or
            no edge crosses the pixel.
    """

    depth: Float[Array, "h w"] | None = None
    range: Float[Array, "h w"] | None = None
    point: Float[Array, "h w 3"] | None = None
    normal: Float[Array, "h w 3"] | None = None
    mask: Bool[Array, "h w"] | None = None
    index: Int[Array, "h w"] | None = None
    part: Int[Array, "h w"] | None = None
    coverage: Float[Array, "h w"] | None = None
    share: Float[Array, "h w"] | None = None
    beside: Float[Array, "h w"] | None = None
