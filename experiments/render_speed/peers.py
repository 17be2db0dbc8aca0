"""The same images by other programs, each as its users would ask it for them.

Mitsuba and Open3D are drawn with where they are installed, OpenGL where there is a
driver. None is told more of the scene than the renderer is, and what each builds before
it casts (a tree, a mesh) is not timed.
"""

__all__ = ["draw_with_gl", "draw_with_mitsuba", "draw_with_numpy", "draw_with_open3d"]

import functools
import importlib
from typing import Any

import numpy as np
from jaxtyping import Float

import impostor_jax as ij
from experiments.render_speed.cases import rows_of
from experiments.render_speed.drawing import Drawing
from impostor_jax.glsl.offscreen import OffscreenRenderer

SEGMENTS = 64
"""Flat faces around the wall of a mesh."""

MESH_TOLERANCE = 1e-4
"""Median difference of a mesh's depth, in meters: 0.0012 radii lie outside of it."""

NEAR = 0.01
"""Depth in meters from which Mitsuba casts and counts."""

ROUNDING = 1e-5
"""Median difference of Mitsuba's depth, in meters: its formula rounds to 3e-6 m on
cylinders of 5 mm, a meter away."""

VARIANTS = ("llvm_ad_rgb", "scalar_rgb")
"""Of Mitsuba, the first that runs: the former needs LLVM's library."""


def _ray_slopes(
    camera: ij.PinholeCamera,
) -> tuple[Float[np.ndarray, "1 w"], Float[np.ndarray, "h 1"]]:
    """The rays' x/z of every column and y/z of every row."""
    x = (np.arange(camera.width) - float(camera.cx)) / float(camera.fx)
    y = (np.arange(camera.height) - float(camera.cy)) / float(camera.fy)
    return x[None], y[:, None]


def draw_with_numpy(can: ij.Cylinder, camera: ij.PinholeCamera) -> Drawing:
    """The formula of `kernel.c`, on arrays of all pixels in single precision."""
    row = rows_of(can)[0].astype(np.float32)
    c, a, radius, half = row[:3], row[3:6], row[6], row[7] / 2
    w, c_a = np.cross(a, c), c @ a
    x, y = (pixels.astype(np.float32) for pixels in _ray_slopes(camera))

    def call() -> tuple[np.ndarray, ...]:
        d_a, d_c, d_w = (x * v[0] + (y * v[1] + v[2]) for v in (a, c, w))
        across = x * x + (y * y + 1) - d_a * d_a
        gap = radius * radius * across - d_w * d_w
        middle = (d_c - c_a * d_a) / across
        reach = np.sqrt(np.maximum(gap, 0)) / across
        between, slab = c_a / d_a, np.abs(half / d_a)
        enter = np.maximum(middle - reach, between - slab)
        leave = np.minimum(middle + reach, between + slab)
        mask = (gap > 0) & (enter <= leave) & (enter > 0)
        cap = between - slab > middle - reach
        p = np.stack([enter * x - c[0], enter * y - c[1], enter - c[2]], axis=-1)
        of_p = np.where(cap, 0, 1 / radius)
        of_a = np.where(cap, -np.sign(d_a), -(p @ a) / radius)
        normal = of_p[..., None] * p + of_a[..., None] * a
        normal[~mask] = 0
        return np.where(mask, enter, np.float32(np.inf)), normal, mask

    return Drawing(call, lambda: call()[0])


def draw_with_gl(
    renderer: OffscreenRenderer, cylinders: ij.Cylinder, camera: ij.PinholeCamera
) -> Drawing:
    """The package's shaders; upload and read back are part of a call."""
    return Drawing(
        lambda: renderer.draw(cylinders, camera),
        lambda: renderer.draw(cylinders, camera).depth,
    )


def draw_with_mitsuba(
    cylinders: ij.Cylinder, camera: ij.PinholeCamera
) -> Drawing | None:
    """A cylinder and two discs each; a ray through the center of every pixel.

    The camera's principal point must be the middle of the image.
    """
    mi, dr = _module("mitsuba"), _module("drjit")
    if mi is None or dr is None:
        return None
    if mi.variant() is None:
        _choose_variant(mi)
    parts = {**_sensor(mi, camera), **_solids(mi, cylinders)}
    made = mi.load_dict({"type": "scene", **parts})

    def call() -> Any:
        image = mi.render(made, spp=1)
        dr.eval(image)
        dr.sync_thread()
        return image

    def depth() -> Float[np.ndarray, "h w"]:
        x, y = _ray_slopes(camera)
        along = np.array(call())[..., 0]  # the length of the ray
        z = NEAR + along / np.sqrt(1 + x**2 + y**2)
        return np.where(along > 0, z, np.inf)

    return Drawing(call, depth, ROUNDING)


@functools.cache
def _module(name: str) -> Any:
    """A program's module; None where it or a library of the system is missing."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        print(f"{name} is left out: {error}")
        return None


def _choose_variant(mi: Any) -> None:
    """Set the first of Mitsuba's variants that runs."""
    for variant in VARIANTS:
        try:
            mi.set_variant(variant)
            mi.load_dict({"type": "sphere"})
        except (ImportError, RuntimeError) as error:
            print(f"Mitsuba has no {variant}: {error}")
            continue
        print(f"Mitsuba draws with {variant}")
        # Of rounded matrices that it takes for sheared ones.
        mi.set_log_level(mi.LogLevel.Error)
        return
    raise ImportError(f"Mitsuba must run as one of {', '.join(VARIANTS)}")


def _sensor(mi: Any, camera: ij.PinholeCamera) -> dict[str, Any]:
    """Our camera in Mitsuba's words, and the maps that it takes."""
    fov = 2 * np.degrees(np.arctan(camera.width / 2 / camera.fx))
    film = {
        "type": "hdrfilm",
        "width": camera.width,
        "height": camera.height,
        "rfilter": {"type": "box"},
        "component_format": "float32",
    }
    sensor = {
        "type": "perspective",
        "fov": float(fov),
        "fov_axis": "x",
        "near_clip": NEAR,
        "to_world": mi.ScalarTransform4f().look_at([0, 0, 0], [0, 0, 1], [0, -1, 0]),
        "film": film,
        "sampler": {"type": "stratified", "sample_count": 1, "jitter": False},
    }
    maps = {"type": "aov", "aovs": "depth:depth,normal:sh_normal"}
    return {"sensor": sensor, "integrator": maps}


def _solids(mi: Any, cylinders: ij.Cylinder) -> dict[str, Any]:
    """Walls and caps."""
    shapes: dict[str, Any] = {}
    for k, row in enumerate(rows_of(cylinders).astype(float)):
        center, axis, radius, half = row[:3], row[3:6], float(row[6]), row[7] / 2
        low, high = ((center + side * half * axis).tolist() for side in (-1, 1))
        shapes[f"wall{k}"] = {"type": "cylinder", "p0": low, "p1": high}
        shapes[f"wall{k}"]["radius"] = radius
        aside = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))]).tolist()
        size = mi.ScalarTransform4f().scale(radius)
        for name, end, away in (("low", low, -axis), ("high", high, axis)):
            turned = mi.ScalarTransform4f().look_at(end, (end + away).tolist(), aside)
            shapes[f"{name}{k}"] = {"type": "disk", "to_world": turned @ size}
    return shapes


def draw_with_open3d(
    cylinders: ij.Cylinder, camera: ij.PinholeCamera
) -> Drawing | None:
    """A mesh in Embree; the rays are made before."""
    o3d = _module("open3d")
    if o3d is None:
        return None
    made = o3d.t.geometry.RaycastingScene()
    points, triangles = _mesh(cylinders)
    made.add_triangles(o3d.core.Tensor(points), o3d.core.Tensor(triangles))
    x, y = _ray_slopes(camera)
    rays = np.zeros((camera.height, camera.width, 6), np.float32)
    rays[..., 3], rays[..., 4], rays[..., 5] = x, y, 1
    rays = o3d.core.Tensor(rays)
    return Drawing(
        lambda: made.cast_rays(rays),
        lambda: made.cast_rays(rays)["t_hit"].numpy(),
        MESH_TOLERANCE,
    )


def _mesh(
    cylinders: ij.Cylinder,
) -> tuple[Float[np.ndarray, "p 3"], np.ndarray]:
    """Points and triangles of walls of `SEGMENTS` faces, and caps around a midpoint."""
    rows = rows_of(cylinders).astype(float)
    center, axis, radius, height = rows[:, :3], rows[:, 3:6], rows[:, 6], rows[:, 7]
    u = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis), axis=1)])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    angle = 2 * np.pi * np.arange(SEGMENTS) / SEGMENTS
    turn = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    rim = np.einsum("sk,knd->nsd", turn, np.stack([u, np.cross(axis, u)]))
    rim *= radius[:, None, None]
    half = (axis * (height / 2)[:, None])[:, None]
    middle = center[:, None]
    low, high = middle - half, middle + half
    points = np.concatenate([low + rim, high + rim, low, high], axis=1)
    this, after = np.arange(SEGMENTS), (np.arange(SEGMENTS) + 1) % SEGMENTS
    low_end, high_end = (np.full(SEGMENTS, 2 * SEGMENTS + k) for k in (0, 1))
    faces = np.concatenate(
        [
            np.stack([this, after, this + SEGMENTS], axis=-1),
            np.stack([after, after + SEGMENTS, this + SEGMENTS], axis=-1),
            np.stack([low_end, after, this], axis=-1),
            np.stack([high_end, this + SEGMENTS, after + SEGMENTS], axis=-1),
        ]
    )
    first = np.arange(len(rows))[:, None, None] * points.shape[1]
    triangles = (faces[None] + first).reshape(-1, 3)
    return points.reshape(-1, 3).astype(np.float32), triangles.astype(np.uint32)
