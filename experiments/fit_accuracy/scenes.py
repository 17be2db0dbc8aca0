"""Random scenes of a cylinder, with clutter, outliers and a sensor's noise."""

__all__ = ["SENSOR", "Scene", "random_scene"]

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

import impostor_jax as ij
from impostor_jax.geometry.vec3 import Vec3

WIDE = ij.PinholeCamera(525.0, 525.0, 639.5, 479.5, width=1280, height=960)
"""The camera's view with a margin, which shows how much lies out of the frame."""

SENSOR = ij.StructuredLight()

OUTLIERS = 0.1
"""Part of the readings that are drawn from 0.3 to 4 m."""

LEAST_SEEN = 0.6
"""Part of the cylinder's pixels that must be in the frame and not occluded."""


@dataclasses.dataclass(frozen=True)
class Scene:
    """A cylinder, and the image that a sensor has of it."""

    cylinder: ij.Cylinder
    depth: Float[np.ndarray, "h w"]
    mask: Bool[np.ndarray, "h w"]
    sigma: Float[np.ndarray, "h w"]


def random_scene(seed: int) -> Scene:
    """Draw a scene; one that shows too little is drawn again.

    The axis is uniform on the sphere, the center 0.3 to 3 m away, the radius from 1 to
    20 cm and the height from 0.2 to 20 radii, both with uniform logarithms. A plane
    stands behind. In a third of the scenes the cylinder is partly out of the frame, in
    a third it is partly occluded. It shows at least 400 pixels, 150 of them on the
    wall, its radius is at most 0.3 of its distance and the camera is outside.
    """
    rng = np.random.default_rng(seed)
    while True:
        distance = rng.uniform(0.3, 3.0)
        radius = np.exp(rng.uniform(np.log(0.01), np.log(0.2)))
        height = radius * np.exp(rng.uniform(np.log(0.2), np.log(20)))
        axis = rng.normal(size=3)
        kind = rng.integers(3)
        reach = 1.3 if kind == 1 else 0.6
        u = 320 + rng.uniform(-320, 320) * reach
        v = 240 + rng.uniform(-240, 240) * reach
        ray = np.array([(u - 319.5) / 525, (v - 239.5) / 525, 1.0])
        center = distance * ray / np.linalg.norm(ray)
        if radius > 0.3 * distance:
            continue
        cylinder = ij.Cylinder(center, axis, radius, height)
        scene = _scene(cylinder, kind == 2, rng)
        if scene is not None:
            return scene


@jax.jit
def _render(cylinder: ij.Cylinder):
    maps = ij.render(cylinder, WIDE)
    assert maps.depth is not None
    assert maps.normal is not None
    assert maps.mask is not None
    part = np.s_[240:720, 320:960]
    row, col = WIDE.frame.pixels()
    d = WIDE.rays(row, col, maps.depth.dtype).direction.stack()
    cosine = -jnp.sum(maps.normal * d, axis=-1) / jnp.linalg.norm(d, axis=-1)
    point = jnp.where(maps.mask, maps.depth, 0)[..., None] * d - cylinder.center
    along = jnp.abs(point @ cylinder.axis)
    on_wall = maps.mask & (along < cylinder.height / 2 * (1 - 1e-4))
    return (
        maps.depth[part],
        maps.mask[part],
        on_wall[part],
        cosine[part],
        jnp.sum(maps.mask),
    )


def _scene(
    cylinder: ij.Cylinder, occluded: bool, rng: np.random.Generator
) -> Scene | None:
    implicit = cylinder.implicit(Vec3(*jnp.zeros(3)))
    depth, mask, on_wall, cosine, total = (np.asarray(x) for x in _render(cylinder))
    if float(implicit) <= 0 or mask.sum() < 400:
        return None
    row, col = np.mgrid[0:480, 0:640]
    if occluded:
        # A board in front hides the part beyond a line through the object.
        angle = rng.uniform(0, 2 * np.pi)
        place = col * np.cos(angle) + row * np.sin(angle)
        cut = np.quantile(place[mask], rng.uniform(0.6, 1.0))
        board = place > cut
    else:
        board = np.zeros_like(mask)
    seen = mask & ~board
    if seen.sum() < max(400, LEAST_SEEN * total) or (seen & on_wall).sum() < 150:
        return None
    farthest = depth[mask].max()
    tilt = rng.uniform(-0.3, 0.3, 2)
    plane = 1 + tilt[0] * (col - 320) / 525 + tilt[1] * (row - 240) / 525
    behind = (farthest + rng.uniform(0.05, 1.0)) / np.minimum(plane, 1)
    full = np.where(mask, depth, behind)
    full = np.where(board, 0.7 * depth[mask].min(), full)
    cosine = np.where(seen, cosine, 1).astype(np.float32)
    sigma = np.asarray(
        SENSOR.sigma(jnp.asarray(full, jnp.float32), jnp.asarray(cosine))
    )
    read = full + sigma * rng.normal(size=full.shape)
    wrong = rng.random(full.shape) < OUTLIERS
    read = np.where(wrong, rng.uniform(0.3, 4.0, full.shape), read)
    return Scene(cylinder, np.maximum(read, 0).astype(np.float32), seen, sigma)
