"""What a camera sees of drawn scenes, and what its sensor reads: batches in one call.

The images of a batch are made one after the other within the call, `jax.lax.map`: side
by side, each would cast the blocks of pixels that any of them needs. Batches are of one
size; a place that is not in use costs nothing.
"""

__all__ = ["BATCH", "Batch", "Seen", "capture_keys", "readings", "see"]

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray, UInt8, UInt16, UInt32

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.camera.pixels import PixelBox
from impostor_jax.io.depth_image import MAX_UINT16
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.plane import Plane
from impostor_jax.rendering.raycast import render
from impostor_jax.rendering.scene import Scene
from impostor_jax.rendering.shadow import lit
from impostor_jax.rendering.silhouettes import silhouettes
from impostor_jax.sensor.base import NO_READING, AbstractDepthNoise, Scalar

BATCH = 8
"""Images of one call."""

NOTHING = 255
"""Index of a pixel that shows no cylinder."""


class Batch(eqx.Module):
    """Scenes of a batch, and the cameras that see them; all in the camera's frame.

    Attributes:
        camera: One for each scene.
        cylinders: As many for each; those behind the camera only fill up.
        planes: As many for each, None for none.
    """

    camera: PinholeCamera
    cylinders: Cylinder
    planes: Plane | None

    def scene(self) -> Scene:
        """The scene, of a batch that is mapped over."""
        shapes = (self.cylinders, self.planes)
        return Scene([shape for shape in shapes if shape is not None])


class Seen(eqx.Module):
    """What the cameras see; all zeros in a place that is not in use.

    Attributes:
        depth: In meters; `+inf` where there is nothing.
        normal: Unit normals that face the camera.
        index: Which cylinder; `NOTHING` where it is none.
        silhouette: Pixels of each cylinder if nothing hid it.
        whole_count: Number of all in an image with a margin of its own size.
        box: Smallest block of these.
    """

    depth: Float[Array, "*b h w"]
    normal: Float[Array, "*b h w 3"]
    index: UInt8[Array, "*b h w"]
    silhouette: Bool[Array, "*b n h w"]
    whole_count: Int[Array, "*b n"]
    box: PixelBox


@jax.jit
def capture_keys(
    key: PRNGKeyArray, number: UInt32[Array, " b"], attempt: UInt32[Array, " b"]
) -> tuple[Key[Array, " b"], Key[Array, " b"]]:
    """Keys of the scene and of the readings of images, of the key of the dataset."""

    def of(number, attempt):
        own = jax.random.fold_in(jax.random.fold_in(key, number), attempt)
        return jax.random.split(own)

    pairs = jax.vmap(of)(number, attempt)
    return pairs[:, 0], pairs[:, 1]


@jax.jit
def see(batch: Batch, used: Bool[Array, " b"]) -> Seen:
    """Render the scenes of the places that are in use."""

    def one(batch: Batch) -> Seen:
        camera, shape = batch.camera, (batch.camera.height, batch.camera.width)
        outputs = ("depth", "normal", "index")
        maps = render(batch.scene(), camera, outputs)
        assert maps.depth is not None
        assert maps.normal is not None
        assert maps.index is not None
        found = silhouettes(batch.cylinders, camera, margin=shape)
        (count,) = batch.cylinders.batch_shape
        is_cylinder = (maps.index >= 0) & (maps.index < count)
        index = jnp.where(is_cylinder, maps.index, NOTHING).astype(jnp.uint8)
        return Seen(
            depth=maps.depth,
            normal=maps.normal,
            index=index,
            silhouette=found.mask,
            whole_count=found.count,
            box=found.box,
        )

    return _where_used(one, batch, used)


@jax.jit
def readings(
    keys: Key[Array, " b"],
    batch: Batch,
    used: Bool[Array, " b"],
    seen: Seen,
    sensor: AbstractDepthNoise,
    projector_baseline: Scalar | None,
    depth_scale_m: Scalar,
) -> tuple[UInt16[Array, "b h w"], UInt16[Array, "b h w"]]:
    """What the sensor reads, and the depth that is there, both in units of the scale.

    What is farther than 16 bits tell is missing: 0.
    """

    def units(depth: Float[Array, "h w"]) -> UInt16[Array, "h w"]:
        scaled = jnp.round(depth / depth_scale_m)
        return jnp.where(scaled <= MAX_UINT16, scaled, 0).astype(jnp.uint16)

    def one(given):
        key, batch, depth, normal = given
        read = sensor.sample(key, depth, normal, batch.camera)
        if projector_baseline is not None:
            place = jnp.array([projector_baseline, 0.0, 0.0])
            light = lit(batch.scene(), batch.camera, depth, place)
            read = jnp.where(light, read, NO_READING)
        return units(read), units(depth)

    return _where_used(one, (keys, batch, seen.depth, seen.normal), used)


def _where_used(one: Callable[[Any], Any], given: Any, used: Bool[Array, " b"]) -> Any:
    """Map over places; the results of those that are not in use are zeros."""
    first = jax.tree.map(lambda x: x[0], given)
    empty = jax.eval_shape(one, first)

    def of_place(x):
        given, is_used = x
        zeros = jax.tree.map(lambda y: jnp.zeros(y.shape, y.dtype), empty)
        return jax.lax.cond(is_used, lambda: one(given), lambda: zeros)

    return jax.lax.map(of_place, (given, used))
