"""Where OpenGL's conventions meet ours: the only place that knows both.

| thing | OpenGL | here |
|---|---|---|
| pixel center | fragment + 0.5 | (u, v) = (col, row) |
| rows | from the bottom | from the top |
| clip space | x, y, z within -w..w, y up | camera frame, y down, z forward |
| depth buffer | 0..1 | z in meters |

The depth buffer holds z linearly between two planes around all that is drawn. A buffer
of 24 bits then resolves a 17-millionth of that stretch everywhere; the usual encoding,
linear in 1/z, resolves far surfaces coarsely. Only where something drawn has no end
is the encoding hyperbolic, so that an infinite depth is 1.
"""

__all__ = [
    "GLSL",
    "DepthRange",
    "DrawnMaps",
    "depth_range",
    "maps_from_targets",
    "uniforms",
]

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.camera.pinhole import PinholeCamera

GLSL = """
uniform vec2 focal;
uniform vec2 principal;
uniform vec2 image_size;   // width, height
uniform vec3 depth_range;  // near, length and hyperbolic of a DepthRange

vec4 clip_of_pixel(vec2 pixel) {
    vec2 part = (pixel + 0.5) / image_size;
    return vec4(2.0 * part.x - 1.0, 1.0 - 2.0 * part.y, 0.0, 1.0);
}

// A corner of the whole image.
vec4 clip_of_corner(vec2 corner) {
    return vec4(corner, 0.0, 1.0);
}

void ray_of_fragment(vec2 fragment, out vec3 o, out vec3 d) {
    vec2 pixel = vec2(fragment.x - 0.5, image_size.y - fragment.y - 0.5);
    vec2 plane = (pixel - principal) / focal;
#ifdef ORTHOGRAPHIC
    o = vec3(plane, 0.0);
    d = vec3(0.0, 0.0, 1.0);
#else
    o = vec3(0.0);
    d = vec3(plane, 1.0);
#endif
}

float window_depth(float z) {
    float ahead = z - depth_range.x;
    float window = ahead / (depth_range.y + depth_range.z * ahead);
    // Nearer than the cleared buffer, by the last of its 24 bits.
    return min(window, 1.0 - 1.0 / 16777216.0);
}
"""
"""Uniforms and conversions, in front of every shader."""


@dataclasses.dataclass(frozen=True)
class DepthRange:
    """Depths that the depth buffer spans, and how it encodes them.

    Attributes:
        near: z where the buffer holds 0, in meters.
        length: In meters, from there to where it holds 1, or 1/2 if hyperbolic.
        hyperbolic: 0 for a linear encoding, 1 for one that reaches to infinity.
    """

    near: float
    length: float
    hyperbolic: float

    def meters(self, window: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
        """Depth that the buffer's value stands for; `+inf` where it is infinite."""
        ahead = window * self.length
        if self.hyperbolic:
            with np.errstate(divide="ignore"):
                ahead = ahead / (1 - self.hyperbolic * window)
        return self.near + ahead


@dataclasses.dataclass(frozen=True)
class DrawnMaps:
    """What a driver drew, in the camera frame; rows from the top.

    Attributes:
        depth: z in meters; `+inf` where nothing is hit.
        point: Surface point in meters; `+inf` where nothing is hit.
        normal: Unit normal; zero where nothing is hit.
        mask: Whether anything is hit.
        index: Which primitive is hit, counted through all drawn; -1 where none is.
        part: Which piece of its surface, as of `GeometryMaps`; -1 where none is hit.
        buffer_depth: The depth buffer's z in meters, `+inf` where nothing is hit; None
            where it cannot be read.
    """

    depth: Float[np.ndarray, "h w"]
    point: Float[np.ndarray, "h w 3"]
    normal: Float[np.ndarray, "h w 3"]
    mask: Bool[np.ndarray, "h w"]
    index: Int[np.ndarray, "h w"]
    part: Int[np.ndarray, "h w"]
    buffer_depth: Float[np.ndarray, "h w"] | None = None


def depth_range(
    center: Float[np.ndarray, "n 3"], reach: Float[np.ndarray, " n"]
) -> DepthRange:
    """Depths that enclose all that is drawn.

    Args:
        center: Of balls that hold what is drawn, in the camera frame, in meters.
        reach: Their radii; `+inf` for something without end, around a point of it.
    """
    z, ends = center[:, 2], reach[np.isfinite(reach)]
    near, largest = max(float(np.min(z - reach)), 0.0), float(np.max(ends, initial=0.0))
    if len(ends) < len(reach):
        # Half of the buffer for what is no farther than the farthest center.
        farthest = float(np.max(np.linalg.norm(center, axis=-1)))
        return DepthRange(near, (farthest + largest) or 1.0, 1.0)
    # Nothing is seen of what lies behind the camera.
    far = max(float(np.max(z + reach)), near + largest)
    margin = 1e-3 * (far - near)
    near = max(near - margin, 0.0)
    return DepthRange(near, far + margin - near, 0.0)


def uniforms(
    camera: PinholeCamera | OrthographicCamera, stretch: DepthRange
) -> dict[str, tuple[float, ...]]:
    """Values of the shaders' uniforms.

    Args:
        camera: Without a lens, concrete; its pose is not used.
        stretch: Depths that the depth buffer spans.
    """
    return {
        "focal": (float(camera.fx), float(camera.fy)),
        "principal": (float(camera.cx), float(camera.cy)),
        "image_size": (float(camera.width), float(camera.height)),
        "depth_range": dataclasses.astuple(stretch),
    }


def maps_from_targets(
    position: Float[np.ndarray, "h w 4"],
    normal: Float[np.ndarray, "h w 4"],
    window: Float[np.ndarray, "h w"] | None,
    stretch: DepthRange,
) -> DrawnMaps:
    """Maps from the float targets as OpenGL reads them back, the bottom row first.

    Args:
        position: Surface point and index; index -1 where nothing was drawn.
        normal: Normal and part.
        window: The depth buffer; None where it cannot be read.
        stretch: Depths that the buffer spans.
    """
    position, normal = position[::-1], normal[::-1]
    mask = position[..., 3] >= 0
    point = np.where(mask[..., None], position[..., :3], np.inf)
    buffer = None
    if window is not None:
        buffer = stretch.meters(window[::-1].astype(np.float64))
        buffer = np.where(mask, buffer, np.inf)
    return DrawnMaps(
        depth=point[..., 2],
        point=point,
        normal=np.where(mask[..., None], normal[..., :3], 0),
        mask=mask,
        index=position[..., 3].astype(np.int32),
        part=np.where(mask, normal[..., 3], -1).astype(np.int32),
        buffer_depth=buffer,
    )
