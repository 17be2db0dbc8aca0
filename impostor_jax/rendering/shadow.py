"""Which of the surfaces that a camera sees a projector beside it lights.

The scene is cast again from the projector, along the rays to the points that the camera
sees and not over a grid of its own: a shadow's edge is as sharp as the camera's pixels.
Planes need no rays: what the camera sees is on its own side of each, so all is dark if
the projector is on the other side of one, and else a plane hides nothing. One that
holds the camera, to rounding, hides nothing either.
"""

__all__ = ["lit"]

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from impostor_jax.arguments import float_array
from impostor_jax.camera.base import check_planar
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.geometry.rays import Ray
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.numerics import eps
from impostor_jax.primitives.local_world import near_its_camera
from impostor_jax.primitives.plane import Plane
from impostor_jax.rendering.scene import Scene

CLEARANCE = 1000
"""Roundings of a depth by which what casts a shadow must be nearer: 0.12 mm at 1 m in
single precision. Two rays to one point of a slanted surface differ by less."""


@near_its_camera
def lit(
    scene: Scene,
    camera: PinholeCamera,
    depth: Float[Array, "h w"],
    projector: Any,
) -> Bool[Array, "h w"]:
    """Find the pixels whose surface the light of a projector reaches.

    The rest has no reading in a structured-light camera. It has no derivative.

    Args:
        scene: Shapes in the world frame.
        camera: Sees them.
        depth: What it sees: camera-frame z in meters, `+inf` where nothing is hit.
        projector: (3,), its place in the camera frame, in meters. It looks the way the
            camera does; what is not before it gets no light.

    Returns:
        Whether there is a surface that nothing hides from the projector.

    Raises:
        ValueError: `projector` has not the shape (3,), or `depth` is not of the size of
            the camera's image, or the camera is no `PinholeCamera`.
    """
    check_planar(camera)
    if depth.shape != (camera.height, camera.width):
        raise ValueError(
            f"depth must have the shape {(camera.height, camera.width)} of the "
            f"camera's image, got {depth.shape}"
        )
    place = float_array("projector", projector, (3,), "meters")
    return _lit(scene, camera, depth, place)


@jax.jit
def _lit(
    scene: Scene,
    camera: PinholeCamera,
    depth: Float[Array, "h w"],
    projector: Float[Array, "3"],
) -> Bool[Array, "h w"]:
    row, col = camera.frame.pixels()
    ray = camera.rays(row, col, depth.dtype)
    seen = jnp.isfinite(depth)
    place = projector.astype(depth.dtype)
    point = ray.at(jnp.where(seen, depth, 0))
    to_point = point - Vec3.from_array(place)
    before = seen & (to_point.z > 0)
    # NaN where no ray is cast.
    to_point = to_point.where(before, Vec3(*(jnp.full_like(depth, jnp.nan),) * 3))
    light = Ray(Vec3(*(jnp.full_like(depth, x) for x in place)), to_point)
    lit, casting = before, []
    for group in scene.seen_by(camera).groups:
        if isinstance(group.primitives, Plane):
            lit = lit & ~jnp.any(_between(group.primitives, place))
        else:
            casting.append(group)
    if not casting:
        return lit
    rest = eqx.tree_at(lambda scene: scene.groups, scene, tuple(casting))
    return lit & ~rest.occluded(light, 1 - eps(depth.dtype, CLEARANCE))


def _between(plane: Plane, place: Float[Array, "3"]) -> Bool[Array, " n"]:
    """Which of a batch of planes have the camera and a place on different sides."""
    place = place.astype(plane.dtype)
    here, there = (
        plane.implicit(Vec3.from_array(end)) for end in (jnp.zeros_like(place), place)
    )
    size = jnp.linalg.norm(plane.point, axis=-1) + jnp.linalg.norm(place)
    limit = eps(plane.dtype, 8) * size
    least = jnp.minimum(jnp.abs(here), jnp.abs(there))
    return (here * there < 0) & (least > limit)
