"""Where OpenGL's conventions meet ours: the only place that knows both.

| thing | OpenGL | here |
|---|---|---|
| pixel center | fragment + 0.5 | (u, v) = (col, row) |
| rows | from the bottom | from the top |
| clip space | x, y, z within -w..w, y up | camera frame, y down, z forward |
| depth buffer | 0..1 | z in meters |

The depth buffer holds z linearly between two planes around all that is drawn. A buffer
of 24 bits then resolves a 17-millionth of that stretch everywhere; the usual encoding,
linear in 1/z, resolves far surfaces coarsely.
"""

__all__ = [
    "GLSL",
    "DrawnMaps",
    "depth_range",
    "maps_from_targets",
    "meters_from_window",
    "uniforms",
]

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.primitives.cylinder import Cylinder

GLSL = """
uniform vec2 focal;
uniform vec2 principal;
uniform vec2 image_size;   // width, height
uniform vec2 depth_range;  // z at window depth 0 and 1

vec4 clip_of_pixel(vec2 pixel) {
    vec2 part = (pixel + 0.5) / image_size;
    return vec4(2.0 * part.x - 1.0, 1.0 - 2.0 * part.y, 0.0, 1.0);
}

// A corner of the whole image.
vec4 clip_of_corner(vec2 corner) {
    return vec4(corner, 0.0, 1.0);
}

// Cut off by the near plane, as a mesh would be.
vec4 clip_of_point(vec3 p) {
#ifdef ORTHOGRAPHIC
    return clip_of_pixel(focal * p.xy + principal);
#else
    vec4 center = clip_of_pixel(principal);
    vec2 slope = 2.0 * focal / image_size * vec2(1.0, -1.0);
    float near = 1e-3 * depth_range.y;
    return vec4(center.xy * p.z + slope * p.xy, p.z - 2.0 * near, p.z);
#endif
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
    return (z - depth_range.x) / (depth_range.y - depth_range.x);
}
"""
"""Uniforms and conversions, in front of every shader."""


@dataclasses.dataclass(frozen=True)
class DrawnMaps:
    """What a driver drew, in the camera frame; rows from the top.

    Attributes:
        depth: z in meters; `+inf` where nothing is hit.
        point: Surface point in meters; `+inf` where nothing is hit.
        normal: Unit normal; zero where nothing is hit.
        mask: Whether anything is hit.
        index: Which cylinder is hit; -1 where none is.
        on_cap: Whether the surface is a cap.
        buffer_depth: The depth buffer's z in meters; `+inf` where nothing is hit.
    """

    depth: Float[np.ndarray, "h w"]
    point: Float[np.ndarray, "h w 3"]
    normal: Float[np.ndarray, "h w 3"]
    mask: Bool[np.ndarray, "h w"]
    index: Int[np.ndarray, "h w"]
    on_cap: Bool[np.ndarray, "h w"]
    buffer_depth: Float[np.ndarray, "h w"]


def depth_range(cylinders: Cylinder) -> tuple[float, float]:
    """Depths, in meters, that enclose all that is drawn of cylinders (n,).

    Args:
        cylinders: In the camera frame.
    """
    reach = np.hypot(np.asarray(cylinders.radius), np.asarray(cylinders.height) / 2)
    z = np.asarray(cylinders.center)[:, 2]
    near, far = max(float(np.min(z - reach)), 0.0), float(np.max(z + reach))
    # Nothing is seen of what lies behind the camera.
    far = max(far, near + float(np.max(reach)))
    margin = 1e-3 * (far - near)
    return max(near - margin, 0.0), far + margin


def uniforms(
    camera: PinholeCamera | OrthographicCamera, stretch: tuple[float, float]
) -> dict[str, tuple[float, float]]:
    """Values of the shaders' uniforms.

    Args:
        camera: Without a lens, concrete; its pose is not used.
        stretch: Depths at the ends of the depth buffer's range, in meters.
    """
    return {
        "focal": (float(camera.fx), float(camera.fy)),
        "principal": (float(camera.cx), float(camera.cy)),
        "image_size": (float(camera.width), float(camera.height)),
        "depth_range": stretch,
    }


def meters_from_window(window: Any, stretch: tuple[float, float]) -> Any:
    """Depth in meters that the depth buffer's value stands for."""
    near, far = stretch
    return near + window * (far - near)


def maps_from_targets(
    position: Float[np.ndarray, "h w 4"],
    normal: Float[np.ndarray, "h w 4"],
    window: Float[np.ndarray, "h w"],
    stretch: tuple[float, float],
) -> DrawnMaps:
    """Maps from the float targets as OpenGL reads them back, the bottom row first.

    Args:
        position: Surface point and index; index -1 where nothing was drawn.
        normal: Normal, and 1 on a cap.
        window: The depth buffer.
        stretch: Depths that it stands for.
    """
    position, normal, window = position[::-1], normal[::-1], window[::-1]
    mask = position[..., 3] >= 0
    point = np.where(mask[..., None], position[..., :3], np.inf)
    buffer = meters_from_window(window.astype(np.float64), stretch)
    return DrawnMaps(
        depth=point[..., 2],
        point=point,
        normal=np.where(mask[..., None], normal[..., :3], 0),
        mask=mask,
        index=position[..., 3].astype(np.int32),
        on_cap=mask & (normal[..., 3] > 0.5),
        buffer_depth=np.where(mask, buffer, np.inf),
    )
