"""Draw the scene of one image: cylinders and what is around them, seen by the camera.

Everything is drawn on the host from one key, so any worker draws the same scene,
whatever it did before.
"""

__all__ = ["Drawn", "draw_scene", "generator"]

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import UInt32

from data_synth.arrange import Arrangement, Plane, Put
from data_synth.camera_draw import ScannerDraw
from data_synth.catalogue import Item
from data_synth.look import Look, draw_look
from data_synth.pose import Pose, free_pose, ground_frame, holds_camera, placed, stacked
from data_synth.preset import Placement, Preset
from data_synth.scenery import Corners, Mounds, Things
from data_synth.solid import Object

CLUTTER_DEPTH = 0.4, 0.8
"""Where clutter is, as parts of the distance to what the camera looks at."""


@dataclasses.dataclass(frozen=True)
class Drawn:
    """The scene of one image, in the camera's frame.

    Attributes:
        camera: Number of the camera that sees it.
        poses: Of the cylinders, in the order of their labels.
        num_clutter: How many of them, the last ones, need not keep the rules.
        planes: A point and a unit normal of each.
        scenery: What else is there.
        look: Materials and lights; None if no color is wanted.
        failure: Name of the rule that the drawing itself broke; None if none.
    """

    camera: int
    poses: tuple[Pose, ...]
    num_clutter: int
    planes: tuple[Plane, ...]
    scenery: tuple[Object, ...] = ()
    look: Look | None = None
    failure: str | None = None


def generator(data: UInt32[np.ndarray, "2"]) -> np.random.Generator:
    """NumPy's generator, seeded with the data of a key of JAX's."""
    return np.random.default_rng(data.tolist())


def draw_scene(
    preset: Preset, catalogue: tuple[Item, ...], rng: np.random.Generator
) -> Drawn:
    """Draw the scene of one image; what it shows is checked when it is rendered."""
    camera = int(rng.integers(preset.camera.count))
    distance, planes = preset.distance.draw(rng), []
    target = np.array([0.0, 0.0, distance])
    angle = np.radians(preset.elevation.draw(rng))
    # The camera looks down on the ground, whose normal points up: towards -y.
    up = np.array([0.0, -np.cos(angle), -np.sin(angle)])
    if isinstance(preset.camera, ScannerDraw):
        # It stands upright, and sees what is around its foot.
        target = np.array([0.0, preset.camera.stand.draw(rng), 0.0])
        up = np.array([0.0, -1.0, 0.0])
    frame = ground_frame(up)
    if preset.wall is not None:
        far = np.array([0.0, 0.0, preset.wall.draw(rng)])
        planes.append((far, np.array([0.0, 0.0, -1.0])))
    count, num_clutter = int(preset.count.draw(rng)), int(preset.clutter.draw(rng))
    kinds = [kind for kind in preset.scenery for _ in range(int(kind.count.draw(rng)))]
    for kind in kinds:
        if isinstance(kind, Corners):
            planes += [
                (frame @ point + target, frame @ normal)
                for point, normal in kind.draw(preset.spread, rng)
            ]
    far = preset.distance.ends[1]
    mounds = tuple(
        kind.draw(far, rng).transformed(frame, target)
        for kind in kinds
        if isinstance(kind, Mounds)
    )
    things = Arrangement(target, up, planes, preset.is_mixed, rng)
    if preset.ground:
        planes.insert(0, (target, up))
    for number in range(count + num_clutter):
        item = catalogue[int(rng.integers(len(catalogue)))]
        placement = preset.placement[int(rng.integers(len(preset.placement)))]
        if number < count:
            draw = _cylinder(preset, item, placement, things)
        else:
            draw = _clutter(preset, item, things)
        if not things.put(draw):
            return Drawn(camera, (), 0, (), failure="no_room")
    for kind in kinds:
        if isinstance(kind, Things) and not things.put(_object(preset, kind, things)):
            return Drawn(camera, (), 0, (), failure="no_room")
    poses = things.poses
    if any(map(holds_camera, poses)) and preset.placement != ("around",):
        return Drawn(camera, (), 0, (), failure="camera_inside")
    look, appearance = None, preset.appearance
    if appearance is not None:
        # Drawn last: the scene is the same as without.
        above = up if preset.ground else -target / distance
        if preset.placement == ("around",):
            above = None
        look = draw_look(appearance, planes, poses, things.scenery, target, above, rng)
        if look is None:
            return Drawn(camera, (), 0, (), failure="no_room_for_lamp")
    scenery = (*mounds, *things.scenery)
    return Drawn(camera, poses, num_clutter, tuple(planes), scenery, look)


def _cylinder(
    preset: Preset, item: Item, placement: Placement, things: Arrangement
) -> Callable[[], Put | None]:
    """What draws places of a cylinder."""
    target, up, rng = things.target, things.up, things.rng
    bases = things.bases if placement == "stacked" else []
    touches = not bases and _is_to_touch(preset, things)

    def draw() -> Put | None:
        if bases:
            below = bases[int(rng.integers(len(bases)))]
            return stacked(item, below, up, rng), below
        pose = placed(preset, item, placement, target, up, rng)
        return things.against(pose) if touches else (pose, None)

    return draw


def _clutter(preset: Preset, item: Item, things: Arrangement) -> Callable[[], Put]:
    """What draws places of a cylinder before the others."""

    def draw() -> Put:
        near = things.rng.uniform(*CLUTTER_DEPTH) * things.target
        return free_pose(preset.spread, item, near, things.rng), None

    return draw


def _object(
    preset: Preset, kind: Things, things: Arrangement
) -> Callable[[], Put | None]:
    """What draws places of an object of a kind."""
    touches = kind.may_touch and _is_to_touch(preset, things)
    frame = ground_frame(things.up)

    def draw() -> Put | None:
        drawn, leans = kind.draw(preset.spread, things.rng)
        thing = drawn.transformed(frame, things.target)
        if leans is not None:
            return things.against(thing, frame @ leans)
        return things.against(thing) if touches else (thing, None)

    return draw


def _is_to_touch(preset: Preset, things: Arrangement) -> bool:
    """Whether a thing is put in contact; nothing is drawn where none can be."""
    return bool(things.touchable) and things.rng.random() < preset.touching
