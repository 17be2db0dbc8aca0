"""Instances that the contract tests run on."""

import jax.numpy as jnp
import numpy as np

from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.camera.spherical import SphericalCamera
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.primitives.box import Box
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.frustum import Frustum
from impostor_jax.primitives.heightfield import Heightfield
from impostor_jax.primitives.plane import Plane
from impostor_jax.primitives.solid import Solid
from impostor_jax.primitives.sphere import Sphere
from impostor_jax.primitives.torus import Torus
from impostor_jax.primitives.triangle import Triangle
from impostor_jax.sensor.aligned import AlignedDepth
from impostor_jax.sensor.correlated import CorrelatedNoise, LineNoise
from impostor_jax.sensor.dropout import Dropout
from impostor_jax.sensor.flying_pixels import FlyingPixels
from impostor_jax.sensor.gaussian import ConstantNoise
from impostor_jax.sensor.lateral import LateralNoise
from impostor_jax.sensor.matching_window import MatchingWindow
from impostor_jax.sensor.quantization import StereoDisparity
from impostor_jax.sensor.scale_error import ScaleError
from impostor_jax.sensor.structured_light import StructuredLight
from impostor_jax.sensor.time_of_flight import TimeOfFlight

TURNED = np.array([[2, 3, 6], [3, -6, 2], [6, 2, -3]]) / 7

PRIMITIVES = {
    "cylinder": lambda: Cylinder((0.1, -0.2, 3.0), (0.3, 0.8, 0.52), 0.5, 1.4),
    "disc": lambda: Cylinder((0.1, -0.2, 3.0), (0.1, -0.3, 0.9), 0.8, 0.02),
    "rod": lambda: Cylinder((0.1, -0.2, 3.0), (0.9, 0.4, -0.1), 0.02, 2.0),
    "cylinder along z": lambda: Cylinder((0.0, 0.0, 3.0), (0, 0, 1), 0.5, 1.0),
    "sphere": lambda: Sphere((0.1, -0.2, 3.0), 0.5),
    "frustum": lambda: Frustum((0.3, -0.5, 2.8), (-0.1, 0.1, 3.2), 0.5, 0.2),
    "sector": lambda: Frustum(
        (0.3, -0.5, 2.8), (-0.1, 0.1, 3.2), 0.3, 0.5, 4.0, 6.5, (0, 0, -1)
    ),
    "plane": lambda: Plane((0.1, -0.2, 3.0), (0.3, 0.8, 0.52)),
    "box": lambda: Box((0.1, -0.2, 3.0), TURNED, (0.8, 0.6, 1.4)),
    "sheet": lambda: Box((0.1, -0.2, 3.0), TURNED, (1.2, 0.9, 1e-4)),
    "torus": lambda: Torus((0.1, -0.2, 3.0), (0.3, 0.8, 0.52), 0.5, 0.2),
    "triangle": lambda: Triangle(
        [(0.5, -0.7, 2.7), (0.4, 0.5, 3.2), (-0.6, -0.3, 3.1)]
    ),
    "bored can": lambda: (
        Cylinder((0.1, -0.2, 3.0), (0.3, 0.8, 0.52), 0.5, 1.4)
        - Cylinder((0.1, -0.2, 3.0), (0.3, 0.8, 0.52), 0.3, 1.4)
    ),
    "heightfield": lambda: Heightfield(
        [[0.0, 0.3, -0.2], [0.4, -0.3, 0.1], [-0.1, 0.5, 0.2], [0.2, -0.2, 0.0]],
        ((-0.6, 0.6), (-0.5, 0.7)),
        "bicubic",
        world_from_field=RigidTransform(pose().rotation, (0.1, -0.2, 3.0)),
    ),
}

CAMERAS = {
    "pinhole": lambda: PinholeCamera(60.0, 62.0, 31.5, 23.0, 64, 48),
    "distorted": lambda: PinholeCamera(
        60.0, 62.0, 31.5, 23.0, 64, 48, distortion=(-0.2, 0.05, 0.002, -0.001, 0.01)
    ),
    "rational": lambda: PinholeCamera(
        60.0, 62.0, 31.5, 23.0, 64, 48,
        distortion=(0.3, 0.1, 0.001, 0.002, 0.02, 0.35, 0.08, 0.01),
    ),
    "tilted": lambda: PinholeCamera(
        60.0, 62.0, 31.5, 23.0, 64, 48,
        distortion=(
            0.1, 0.02, 0.001, 0.002, 0.01, 0.12, 0.02, 0.0,
            0.002, 0.001, -0.002, 0.001, 0.03, -0.02,
        ),
    ),
    "fisheye": lambda: PinholeCamera(
        40.0, 41.0, 31.5, 23.0, 64, 48, distortion=(0.05, -0.01, 0.003, 0.001),
        fisheye=True,
    ),
    "orthographic": lambda: OrthographicCamera(60.0, 62.0, 31.5, 23.0, 64, 48),
    # Beams that lie closer in the middle, and columns that cross the seam behind.
    "spherical": lambda: SphericalCamera(
        np.linspace(1.1, -1.1, 48) ** 3, np.linspace(-2.5, 3.5, 64)
    ),
    "posed": lambda: PinholeCamera(
        60.0, 62.0, 31.5, 23.0, 64, 48, camera_from_world=pose()
    ),
}  # fmt: skip

NOISES = {
    "constant": lambda: ConstantNoise(0.002),
    "structured light": StructuredLight,
    "stereo": lambda: StereoDisparity(525.0),
    "lateral": lambda: LateralNoise(StructuredLight()),
    "dropout": lambda: Dropout(ConstantNoise(0.002), rate=0.1),
    "flying pixels": lambda: FlyingPixels(ConstantNoise(0.002)),
    "matching window": lambda: MatchingWindow(ConstantNoise(0.002), half_window=2),
    "time of flight": TimeOfFlight,
    # Of hardly any error that readings share.
    "correlated": lambda: CorrelatedNoise(ConstantNoise(0.002), 1e-5, 30.0, power=1),
    "lines": lambda: LineNoise(ConstantNoise(0.002), 1e-5, "columns", power=1),
    "scale": lambda: ScaleError(ConstantNoise(0.002), 1e-5, law="disparity"),
    "aligned": lambda: AlignedDepth(ConstantNoise(0.002), 1.4),
    "all parts": lambda: Dropout(FlyingPixels(LateralNoise(StereoDisparity(525.0)))),
}


def pose() -> RigidTransform:
    """A camera that looks at the cases from the side."""
    angle = 0.4
    rotation = [
        [np.cos(angle), 0.0, -np.sin(angle)],
        [0.0, 1.0, 0.0],
        [np.sin(angle), 0.0, np.cos(angle)],
    ]
    return RigidTransform(rotation, (0.9, 0.1, 0.3))


def rays_at(primitive) -> Ray:
    """Rays that break formulas, then random ones, at a primitive.

    All are met as the cylinder that holds them, a plane as one of its discs. Along the
    axis on it, off it and outside; parallel to a cap, in its plane and between the
    planes; grazing the wall; through the rim; away from it; from inside, along, across
    and skew to the axis; then 200 random rays from around it.
    """
    rng = np.random.default_rng(0)
    c, a, u, r, h = holder(primitive)
    w = np.cross(a, u)
    far = 3 * (r + h)
    pairs = [
        (c - far * a, a),
        (c - far * a + r / 2 * u, a),
        (c - far * a + 2 * r * u, a),
        (c - far * u, u),
        (c - far * u + h * a, u),
        (c - far * u + h / 2 * a, u),
        (c - far * u + 2 * h * a, u),
        (c - far * u + r * w, u),
        (c - far * u + r * (1 - 1e-6) * w, u),
        (c + far * (u + a), h * a + r * u - far * (u + a)),
        (c + far * u, u),
        (c, a),
        (c, u),
        (c, 0.3 * a + 0.5 * u + 0.1 * w),
        (c + 0.5 * h * a + 0.5 * r * w, -0.3 * a + 0.5 * u),
    ]
    for _ in range(200):
        origin = c + rng.uniform(-far, far, 3)
        target = c + rng.uniform(-1, 1) * h * a + 1.2 * r * rng.uniform(-1, 1, 3)
        pairs.append((origin, target - origin))
    origins, directions = jnp.asarray(np.array(pairs)).swapaxes(0, 1)
    return Ray(
        Vec3.from_array(origins.astype(primitive.dtype)),
        Vec3.from_array(directions.astype(primitive.dtype)),
    )


def is_decided(primitive, rays: Ray) -> np.ndarray:
    """Rays whose hit or miss is no matter of rounding, as it is of one in a flat face.

    The fifth ray lies in a face of a box, the tenth meets the rim of a bored can; many
    lie in a plane, start on it or run along it.
    """
    if isinstance(primitive, Plane):
        along = rays.direction.dot(Vec3.from_array(primitive.unit_normal))
        start = primitive.implicit(rays.origin)
        return np.asarray((jnp.abs(along) > 1e-6) & (jnp.abs(start) > 1e-6))
    number = np.arange(rays.origin.x.size)
    if isinstance(primitive, Solid):
        return number != 9
    return ~((number == 4) & isinstance(primitive, Box))


def holder(primitive):
    """Center, axis, a direction across it, radius and half-height of a cylinder."""
    if isinstance(primitive, Solid):
        return holder(primitive.shapes[0])
    if isinstance(primitive, Box):
        u, _, a = np.asarray(primitive.rotation, float).T
        r, _, h = np.asarray(primitive.size, float) / 2
        return np.asarray(primitive.center, float), a, u, r, h
    if isinstance(primitive, Heightfield):
        pose = primitive.world_from_field
        c, a, r, h = pose.translation, np.asarray(pose.rotation)[:, 1], 0.6, 0.4
    elif isinstance(primitive, Plane):
        c, a, r, h = primitive.point, primitive.unit_normal, 1.0, 0.0
    elif isinstance(primitive, Cylinder):
        c, a, r = primitive.center, primitive.axis, primitive.radius
        h = float(primitive.height) / 2
    elif isinstance(primitive, Torus):
        c, a, h = primitive.center, primitive.axis, float(primitive.minor_radius)
        r = primitive.major_radius + h
    elif isinstance(primitive, Triangle):
        # As a ball beside it, so that no ray lies in the sheet or starts on it.
        c = np.mean(np.asarray(primitive.vertices), axis=0) + np.float32(0.03)
        a, r, h = (0.0, 0.6, 0.8), 0.5, 0.5
    elif isinstance(primitive, Frustum):
        p1, p2 = np.asarray(primitive.p1, float), np.asarray(primitive.p2, float)
        h = np.linalg.norm(p2 - p1) / 2
        # Off the axis, which is the edge of a sector.
        c, a = (p1 + p2) / 2 + (0.011, 0.007, -0.013), (p2 - p1) / (2 * h)
        r = max(float(primitive.radius1), float(primitive.radius2))
    else:
        c, a = primitive.center, (0.0, 0.6, 0.8)
        r = h = float(primitive.radius)
    c, a = np.asarray(c, float), np.asarray(a, float)
    return c, a, np.linalg.svd(a[None])[2][1], float(r), h
