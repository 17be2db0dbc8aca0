"""The images of a dataset: drawn, checked against the rules, seen and read.

Image k is made of `jax.random.fold_in(key, k)` and the number of its attempt, so it
does not depend on which other images are made, where or when.
"""

__all__ = [
    "STAGES",
    "Clock",
    "Image",
    "Plan",
    "captured",
    "catalogue_of",
    "draw_scenes",
    "images",
]

import collections
import contextlib
import dataclasses
import time
from collections.abc import Iterable, Iterator, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray, UInt16, UInt32

from data_synth.appearance import Appearance
from data_synth.batch import batch_of
from data_synth.camera_draw import draw_cameras
from data_synth.capture import (
    BATCH,
    KEPT,
    RULES,
    Captured,
    SceneBatch,
    capture,
    capture_keys,
)
from data_synth.catalogue import Item, draw_catalogue
from data_synth.draw import Drawn, draw_scene, generator
from data_synth.manifest import Manifest
from data_synth.sequence import FRAME_RATE, draw_motion
from impostor_jax.camera.pixels import PixelBox
from impostor_jax.io.camera_file import FiledCamera

MOTION = 2**31
"""In place of the number of an attempt: what a sequence's motion is drawn of."""

STAGES = ("drawing", "capturing", "coding", "writing")
"""What the time of a dataset goes into."""


class Clock:
    """Seconds that were spent on each of the stages."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = dict.fromkeys(STAGES, 0.0)

    @contextlib.contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time of a block."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] += time.perf_counter() - start


@dataclasses.dataclass(frozen=True)
class Plan:
    """What all images of a dataset share.

    Attributes:
        manifest: What is to be made.
        key: Of all that is drawn.
        catalogue: Sizes of the cylinders.
        cameras: The cameras.
    """

    manifest: Manifest
    key: PRNGKeyArray
    catalogue: tuple[Item, ...]
    cameras: tuple[FiledCamera, ...]

    @staticmethod
    def of(manifest: Manifest) -> "Plan":
        """The plan of a manifest."""
        preset, key = manifest.preset, jax.random.key(manifest.seed)
        catalogue, rng = catalogue_of(manifest)
        cameras = draw_cameras(preset.camera, rng)
        return Plan(manifest, key, catalogue, cameras)


def catalogue_of(
    manifest: Manifest,
) -> tuple[tuple[Item, ...], np.random.Generator]:
    """Sizes of a dataset's cylinders, and the generator of what is drawn next."""
    preset, key = manifest.preset, jax.random.key(manifest.seed)
    rng = generator(np.asarray(jax.random.key_data(key)))
    return draw_catalogue(preset.objects, preset.radius, preset.aspect, rng), rng


@dataclasses.dataclass(frozen=True)
class Image:
    """One image.

    Attributes:
        number: Its number in the dataset.
        scene: What is there.
        camera: What sees it.
        reading: What the sensor reads, in units of the depth files; 0 for nothing.
        clean: The depth that is there, in the same units.
        normal: Unit normals that face the camera, if they are written.
        color: Linear red, green and blue, if they are written.
        visible: Pixels of each cylinder that nothing hides.
        silhouettes: Pixels of each if nothing hid it.
        whole_counts: Number of these in the image and, but for a scanner, a margin of
            its own size.
        boxes: Of these.
        rejected: How often each rule rejected a scene for this image.
        seconds: Time since the first image of its sequence; None if it is of none.
        camera_from_world: Pose of the camera, whose frame the world is at the first
            image of a sequence; likewise.
    """

    number: int
    scene: Drawn
    camera: FiledCamera
    reading: UInt16[np.ndarray, "h w"]
    clean: UInt16[np.ndarray, "h w"]
    normal: Float[np.ndarray, "h w 3"] | None
    color: Float[np.ndarray, "h w 3"] | None
    visible: Bool[np.ndarray, "n h w"]
    silhouettes: Bool[np.ndarray, "n h w"]
    whole_counts: Int[np.ndarray, " n"]
    boxes: list[PixelBox]
    rejected: dict[str, int]
    seconds: float | None = None
    camera_from_world: Float[np.ndarray, "4 4"] | None = None


def images(plan: Plan, numbers: Sequence[int], clock: Clock) -> Iterator[Image]:
    """Make images, in the order of their numbers.

    Of a dataset of sequences they are those of one.

    Raises:
        ValueError: The rules reject all scenes that are drawn for an image.
    """
    if plan.manifest.is_sequence:
        yield from _sequence(plan, numbers, clock)
        return
    for first in range(0, len(numbers), BATCH):
        yield from _window(plan, numbers[first : first + BATCH], clock)


def _window(plan: Plan, numbers: Sequence[int], clock: Clock) -> list[Image]:
    """At most a batch of images; places of scenes that are rejected are drawn again."""
    rules = plan.manifest.preset.rules
    attempt = np.zeros(BATCH, np.uint32)
    rejected = [collections.Counter() for _ in numbers]
    made: dict[int, Image] = {}

    def reject(place: int, rule: str) -> None:
        attempt[place] += 1
        rejected[place][rule] += 1
        if attempt[place] >= rules.most_attempts:
            raise ValueError(_no_scene(numbers[place], rejected[place]))

    while len(made) < len(numbers):
        with clock.stage("drawing"):
            keys = _keys(plan, numbers, attempt)
            scenes = draw_scenes(plan, keys[0], set(range(len(numbers))) - set(made))
            for k, scene in list(scenes.items()):
                if scene.failure is not None:
                    reject(k, scene.failure)
                    del scenes[k]
            if not scenes:
                continue
            batch = batch_of(plan.manifest.preset, plan.cameras, scenes)
        with clock.stage("capturing"):
            seen = captured(plan, keys[1], batch)
        for k, scene in scenes.items():
            broken = int(seen.broken_rule[k])
            if broken == KEPT:
                made[k] = _image(plan, numbers[k], k, scene, seen, rejected[k])
            else:
                reject(k, RULES[broken])
    return [made[k] for k in range(len(numbers))]


def _sequence(plan: Plan, numbers: Sequence[int], clock: Clock) -> Iterator[Image]:
    """The images of a sequence: one as any other, and what it shows later."""
    preset = plan.manifest.preset
    (first,) = _window(plan, numbers[:1], clock)
    key = jax.random.fold_in(jax.random.fold_in(plan.key, numbers[0]), MOTION)
    rng = generator(np.asarray(jax.random.key_data(key)))
    motion = draw_motion(first.scene, preset.ground, rng)
    yield dataclasses.replace(
        first, seconds=0.0, camera_from_world=motion.camera_from_world(0.0)
    )
    for start in range(1, len(numbers), BATCH):
        some = numbers[start : start + BATCH]
        times = [(start + k) / FRAME_RATE for k in range(len(some))]
        with clock.stage("drawing"):
            keys = _keys(plan, some, np.zeros(BATCH, np.uint32))
            scenes = {k: motion.after(seconds) for k, seconds in enumerate(times)}
            batch = batch_of(preset, plan.cameras, scenes)
            # What is hidden later stays.
            unbound = jnp.zeros_like(batch.num_bound)
            batch = dataclasses.replace(batch, num_bound=unbound)
        with clock.stage("capturing"):
            seen = captured(plan, keys[1], batch)
        for k, scene in scenes.items():
            image = _image(plan, some[k], k, scene, seen, {})
            pose = motion.camera_from_world(times[k])
            yield dataclasses.replace(image, seconds=times[k], camera_from_world=pose)


def _keys(
    plan: Plan, numbers: Sequence[int], attempt: UInt32[np.ndarray, " b"]
) -> tuple[Key[Array, " b"], Key[Array, " b"]]:
    """Keys of the scenes and of the readings of at most a batch of images."""
    padded = jnp.array([*numbers, *[0] * (BATCH - len(numbers))], jnp.uint32)
    return capture_keys(plan.key, padded, jnp.asarray(attempt))


def draw_scenes(
    plan: Plan, keys: Key[Array, " b"], places: Iterable[int]
) -> dict[int, Drawn]:
    """A scene for each of some places of a batch."""
    data, preset = np.asarray(jax.random.key_data(keys)), plan.manifest.preset
    return {k: draw_scene(preset, plan.catalogue, generator(data[k])) for k in places}


def captured(plan: Plan, keys: Key[Array, " b"], batch: SceneBatch) -> Captured:
    """What there is to see of a batch, as NumPy's arrays: views of JAX's."""
    preset = plan.manifest.preset
    drawn, rough = preset.appearance or Appearance(), preset.roughness
    seen = capture(
        keys,
        batch,
        tuple(float(getattr(preset.rules, name)) for name in RULES),
        preset.sensor,
        preset.projector_baseline,
        None if rough is None else (rough.deviation, rough.length),
        preset.depth_scale_mm / 1e3,
        plan.manifest.normals,
        drawn.bounces,
        drawn.samples,
    )
    return jax.tree.map(np.asarray, seen)


def _image(
    plan: Plan,
    number: int,
    place: int,
    scene: Drawn,
    seen: Captured,
    rejected: dict[str, int],
) -> Image:
    """The image in a place of a batch."""
    count = len(scene.poses)
    own = jax.tree.map(lambda x: x[place], seen)
    each = np.arange(count, dtype=np.uint8)[:, None, None]
    return Image(
        number=number,
        scene=scene,
        camera=plan.cameras[scene.camera],
        reading=own.reading,
        clean=own.clean,
        normal=own.normal,
        color=own.color,
        visible=own.index == each,
        silhouettes=own.silhouette[:count],
        whole_counts=own.whole_count[:count],
        boxes=[jax.tree.map(lambda x, k=k: int(x[k]), own.box) for k in range(count)],
        rejected=dict(sorted(rejected.items())),
    )


def _no_scene(number: int, rejected: dict[str, int]) -> str:
    counts = ", ".join(f"{count} by {rule}" for rule, count in rejected.items())
    return (
        f"preset must draw scenes that its rules allow: all scenes for image {number} "
        f"were rejected, {counts}"
    )
