"""What a camera sees of drawn scenes, and what its sensor reads: batches in one call.

The images of a batch are made one after the other within the call, `jax.lax.map`: side
by side, each would cast the blocks of pixels that any of them needs. Batches are of one
size; a place that is not in use costs nothing, and a scene that breaks a rule has no
readings.
"""

__all__ = [
    "BATCH",
    "KEPT",
    "RULES",
    "Captured",
    "SceneBatch",
    "ShownLook",
    "capture",
    "capture_keys",
]

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray, UInt8, UInt16, UInt32

from data_synth.preset import MAX_CYLINDERS
from data_synth.roughness import roughened
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.camera.pixels import PixelBox
from impostor_jax.effort import Effort
from impostor_jax.geometry.vec3 import Vec3
from impostor_jax.io.camera_file import FiledCamera
from impostor_jax.io.depth_image import FARTHEST
from impostor_jax.numerics import Scalar, eps
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.rendering.lights import AbstractLight, AmbientLight, PointLight
from impostor_jax.rendering.material import Material
from impostor_jax.rendering.render import render
from impostor_jax.rendering.scene import Scene
from impostor_jax.rendering.shadow import lit
from impostor_jax.rendering.silhouettes import silhouettes
from impostor_jax.rendering.trace import trace
from impostor_jax.sensor.base import NO_READING, AbstractDepthNoise

BATCH = 8
"""Images of one call."""

NO_CYLINDER = MAX_CYLINDERS
"""Index of a pixel that shows no cylinder."""

RULES = ("smallest_outline", "visible_fraction")
"""Rules that need a look at the scene, in the order in which they are checked."""

KEPT = -1
"""In place of the number of a rule: none is broken."""


class ShownLook(eqx.Module):
    """What the scenes of a batch are made of, and how they are lit.

    Attributes:
        material: Of each shape.
        intensity: Of the light from all sides, and of each lamp at 1 meter.
        position: Of the lamps, after any for the first light.
        background: Red, green and blue.
    """

    material: Material
    intensity: Float[Array, "*b k"]
    position: Float[Array, "*b k 3"]
    background: Float[Array, "*b 3"]

    def lights(self) -> list[AbstractLight]:
        """The lights, of a batch that is mapped over."""
        ambient, *lamps = self.intensity
        return [
            AmbientLight(ambient),
            *(
                PointLight(place, light, "inverse_square")
                for place, light in zip(self.position[1:], lamps, strict=True)
            ),
        ]


class SceneBatch(eqx.Module):
    """Scenes of a batch, and the cameras that see them; all in the camera's frame.

    Attributes:
        camera: One for each scene.
        cylinders: As many for each; those behind the camera only fill up.
        others: What else there is, by type: as many of each for each scene.
        num_bound: How many of the cylinders, the first ones, must keep the rules.
        is_used: Whether a place is in use.
        look: Materials and lights; None if no color is wanted.
    """

    camera: FiledCamera
    cylinders: Cylinder
    others: tuple[AbstractPrimitive, ...]
    num_bound: Int[Array, "*b"]
    is_used: Bool[Array, "*b"]
    look: ShownLook | None

    def scene(self) -> Scene:
        """The scene, of a batch that is mapped over."""
        return Scene([self.cylinders, *self.others])


class Captured(eqx.Module):
    """What there is to see of scenes; zeros in a place that is not in use.

    Attributes:
        broken_rule: Number of the first of `RULES` that a scene breaks, `KEPT` if it
            keeps them.
        reading: What the sensor reads, in units of the depth files. 0 where it reads
            nothing, or farther than 16 bits tell; and if a rule is broken.
        clean: The depth that is there, in the same units.
        normal: Unit normals that face the camera; None if not wanted.
        color: Linear red, green and blue; None if not wanted.
        index: Which cylinder is seen; `NO_CYLINDER` where it is none.
        silhouette: Pixels of each cylinder if nothing hid it.
        whole_count: Number of all in an image with a margin of its own size, or in a
            scan.
        box: Smallest block of these.
    """

    broken_rule: Int[Array, "*b"]
    reading: UInt16[Array, "*b h w"]
    clean: UInt16[Array, "*b h w"]
    normal: Float[Array, "*b h w 3"] | None
    color: Float[Array, "*b h w 3"] | None
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


@partial(jax.jit, static_argnames=("with_normal", "bounces", "samples"))
def capture(
    keys: Key[Array, " b"],
    batch: SceneBatch,
    limits: tuple[Scalar, Scalar],
    sensor: AbstractDepthNoise,
    projector_baseline: Scalar | None,
    roughness: tuple[Scalar, Scalar] | None,
    depth_scale_m: Scalar,
    with_normal: bool,
    bounces: int,
    samples: int,
) -> Captured:
    """Render the scenes of a batch, and read those that keep the rules.

    Args:
        keys: Of the readings.
        batch: The scenes.
        limits: Of `RULES`, in their order.
        sensor: What reads.
        projector_baseline: As in a preset.
        roughness: Deviation and length, as in a preset.
        depth_scale_m: Meters a unit of the readings.
        with_normal: Whether normals are wanted.
        bounces: Of the rays of color images.
        samples: Of these, along each side of a pixel.
    """

    def units(depth: Float[Array, "h w"]) -> UInt16[Array, "h w"]:
        scaled = jnp.round(depth / depth_scale_m)
        return jnp.where(scaled <= FARTHEST, scaled, 0).astype(jnp.uint16)

    def read(
        key: PRNGKeyArray, batch: SceneBatch, depth: Float[Array, "h w"], normal: Vec3
    ) -> UInt16[Array, "h w"]:
        camera, scene = batch.camera, depth
        if roughness is not None:
            key, own = jax.random.split(key)
            scene = roughened(own, depth, normal.stack(), camera, *roughness)
        reading = sensor.sample(key, scene, normal.stack(), camera)
        if projector_baseline is not None:
            place = jnp.array([projector_baseline, 0.0, 0.0])
            assert isinstance(camera, PinholeCamera)
            light = lit(batch.scene(), camera, depth, place)
            reading = jnp.where(light, reading, NO_READING)
        return units(reading)

    def draw(batch: SceneBatch) -> Float[Array, "h w 3"] | None:
        look = batch.look
        if look is None:
            return None
        return trace(
            batch.scene(), batch.camera, look.lights(), look.material,
            look.background, bounces, effort=Effort(samples=samples),
        )  # fmt: skip

    def one(key: PRNGKeyArray, batch: SceneBatch) -> Captured:
        camera, shape = batch.camera, (batch.camera.height, batch.camera.width)
        maps = render(batch.scene(), camera, ("depth", "normal", "index"))
        assert maps.depth is not None
        assert maps.normal is not None
        assert maps.index is not None
        # Beyond a scan there is what it does not look at.
        margin = shape if isinstance(camera, PinholeCamera) else (0, 0)
        found = silhouettes(batch.cylinders, camera, margin=margin)
        (count,) = batch.cylinders.batch_shape
        is_cylinder = (maps.index >= 0) & (maps.index < count)
        index = jnp.where(is_cylinder, maps.index, NO_CYLINDER).astype(jnp.uint8)
        broken = _broken_rule(batch.num_bound, index, found.count, limits)
        # By component, whose stack and slices XLA leaves out.
        given = (key, batch, maps.depth, Vec3.from_array(maps.normal))
        nothing = jnp.zeros(shape, jnp.uint16)
        no_color = None if batch.look is None else jnp.zeros((*shape, 3))
        return Captured(
            broken_rule=broken,
            reading=jax.lax.cond(broken == KEPT, read, lambda *_: nothing, *given),
            clean=units(maps.depth),
            normal=maps.normal if with_normal else None,
            color=jax.lax.cond(broken == KEPT, draw, lambda _: no_color, batch),
            index=index,
            silhouette=found.mask,
            whole_count=found.count,
            box=found.box,
        )

    def of_place(place: tuple[PRNGKeyArray, SceneBatch]) -> Captured:
        nothing = jax.tree.map(
            lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(one, *place)
        )
        return jax.lax.cond(place[1].is_used, one, lambda *_: nothing, *place)

    return jax.lax.map(of_place, (keys, batch))


def _broken_rule(
    num_bound: Int[Array, ""],
    index: UInt8[Array, "h w"],
    whole_count: Int[Array, " n"],
    limits: tuple[Scalar, Scalar],
) -> Int[Array, ""]:
    """Number of the first rule that a scene breaks, `KEPT` if there is none."""
    number = jnp.arange(whole_count.shape[0], dtype=jnp.int32)
    # Counted in floating point, which XLA adds in lanes and whole numbers it does not.
    visible = jax.lax.map(
        lambda k: jnp.sum((index == k.astype(jnp.uint8)).astype(jnp.float32)), number
    )
    smallest_outline, visible_fraction = limits
    # Less by more than rounding: a part that is exactly the least keeps the rule.
    whole = whole_count.astype(jnp.float32) * (1 - eps(jnp.float32, 4))
    too_little = jnp.stack(
        [visible < smallest_outline, visible < visible_fraction * whole]
    )
    is_broken = jnp.any(too_little & (number < num_bound)[None], axis=1)
    return jnp.where(jnp.any(is_broken), jnp.argmax(is_broken), KEPT)
