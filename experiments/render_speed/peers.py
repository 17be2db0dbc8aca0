"""The same images by other programs, each as its users would ask it for them.

Mitsuba and Open3D are drawn with where they are installed, OpenGL where there is a
driver. None is told more of the scene than the renderer is, and what each builds before
it casts (a tree, a mesh) is not timed.
"""

__all__ = [
    "draw_with_gl",
    "draw_with_mitsuba",
    "draw_with_numpy",
    "draw_with_open3d",
    "has_variant",
    "mesh_of",
    "module_of",
    "solids_of",
]

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

ROUNDING = 1e-5
"""Median difference of Mitsuba's depth, in meters: its formula rounds to 3e-6 m on
cylinders of 5 mm, a meter away."""

VARIANT = "llvm_ad_rgb"
"""Of Mitsuba: casts many rays at once."""


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
    """A cylinder and two discs each, on LLVM; the rays are made before.

    Their intersection is recorded once, and run at each call. An image by the
    integrator `aov` shows the same in many times the time.
    """
    mi, dr = module_of("mitsuba"), module_of("drjit")
    if mi is None or dr is None or not has_variant(mi):
        return None
    made = mi.load_dict({"type": "scene", **solids_of(mi, cylinders)})
    rays = np.stack(np.broadcast_arrays(*_ray_slopes(camera), 1.0), axis=-1)
    rays = (rays / np.linalg.norm(rays, axis=-1, keepdims=True)).reshape(-1, 3)
    direction = mi.Vector3f(rays.T.astype(np.float32))
    ray = mi.Ray3f(dr.zeros(mi.Point3f, len(rays)), direction)

    @dr.freeze
    def intersect(ray: Any) -> tuple[Any, Any]:
        found = made.ray_intersect(ray)
        return found.t * ray.d.z, found.n

    def maps() -> tuple[Any, Any]:
        drawn = intersect(ray)
        dr.eval(drawn)
        dr.sync_thread()
        return drawn

    # JAX must not ask its arrays whether they are ready: they have any attribute.
    def call() -> None:
        maps()

    def depth() -> Float[np.ndarray, "h w"]:
        return np.array(maps()[0]).reshape(camera.height, camera.width)

    return Drawing(call, depth, ROUNDING)


@functools.cache
def module_of(name: str) -> Any:
    """A program's module; None where it or a library of the system is missing."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        print(f"{name} is left out: {error}")
        return None


def has_variant(mi: Any) -> bool:
    """Whether Mitsuba can run on LLVM, whose library the system must have."""
    try:
        mi.set_variant(VARIANT)
        mi.Float([0.0])
    except (ImportError, RuntimeError) as error:
        print(f"mitsuba is left out: {error}")
        return False
    # Of rounded matrices that it takes for sheared ones.
    mi.set_log_level(mi.LogLevel.Error)
    return True


def solids_of(mi: Any, cylinders: ij.Cylinder) -> dict[str, Any]:
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
    o3d = module_of("open3d")
    if o3d is None:
        return None
    made = o3d.t.geometry.RaycastingScene()
    points, triangles = mesh_of(cylinders)
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


def mesh_of(
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
