"""Draw the scene of one image: cylinders and planes, all in the camera's frame.

Everything is drawn on the host from one key, so any worker draws the same scene,
whatever it did before.
"""

__all__ = ["Drawn", "Pose", "draw_cameras", "draw_scene", "generator"]

import dataclasses

import numpy as np
from jaxtyping import Float, UInt32

from data_synth.catalogue import Item
from data_synth.preset import CameraDraw, Placement, Preset
from impostor_jax.camera.pinhole import PinholeCamera

GAP = 0.002
"""Least distance of two cylinders, in meters."""

PLACINGS = 50
"""Places that are tried for a cylinder before the scene is given up."""

CLUTTER_DEPTH = 0.4, 0.8
"""Where clutter is, as parts of the distance to what the camera looks at."""


@dataclasses.dataclass(frozen=True)
class Pose:
    """One cylinder of an image, in the camera's frame.

    Attributes:
        item: Its size.
        center: In meters.
        rotation: From the mesh's frame, whose z is the axis.
    """

    item: Item
    center: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3 3"]

    @property
    def axis(self) -> Float[np.ndarray, "3"]:
        """Unit vector."""
        return self.rotation[:, 2]


@dataclasses.dataclass(frozen=True)
class Drawn:
    """The scene of one image, in the camera's frame.

    Attributes:
        camera: Number of the camera that sees it.
        poses: Of the cylinders, in the order of their labels.
        num_clutter: How many of them, the last ones, need not keep the rules.
        planes: A point and a unit normal of each.
        failure: Name of the rule that the drawing itself broke; None if none.
    """

    camera: int
    poses: tuple[Pose, ...]
    num_clutter: int
    planes: tuple[tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]], ...]
    failure: str | None = None


def generator(data: UInt32[np.ndarray, "2"]) -> np.random.Generator:
    """NumPy's generator, seeded with the data of a key of JAX's."""
    return np.random.default_rng(data.tolist())


def draw_cameras(
    draw: CameraDraw, rng: np.random.Generator
) -> tuple[PinholeCamera, ...]:
    """Draw the cameras of a dataset."""
    cameras = []
    for _ in range(draw.count):
        focal = draw.focal.draw(rng)
        shift = [draw.shift.draw(rng) for _ in range(2)]
        distortion = None
        if draw.distortion is not None:
            distortion = [*(part.draw(rng) for part in draw.distortion), 0.0, 0.0, 0.0]
        camera = PinholeCamera(
            focal,
            focal,
            (draw.width - 1) / 2 + shift[0],
            (draw.height - 1) / 2 + shift[1],
            width=draw.width,
            height=draw.height,
            distortion=distortion,
        )
        cameras.append(camera)
    return tuple(cameras)


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
    if preset.ground:
        planes.append((target, up))
    if preset.wall is not None:
        far = np.array([0.0, 0.0, preset.wall.draw(rng)])
        planes.append((far, np.array([0.0, 0.0, -1.0])))
    count, num_clutter = int(preset.count.draw(rng)), int(preset.clutter.draw(rng))
    poses: list[Pose] = []
    for number in range(count + num_clutter):
        item = catalogue[int(rng.integers(len(catalogue)))]
        placement = preset.placement[int(rng.integers(len(preset.placement)))]
        for _ in range(PLACINGS):
            if number < count:
                pose = _place(preset, item, placement, target, up, rng)
            else:
                near = rng.uniform(*CLUTTER_DEPTH) * target
                pose = _free(preset.spread, item, near, rng)
            if all(_apart(pose, other) for other in poses):
                break
        else:
            return Drawn(camera, (), 0, (), "no_room")
        poses.append(pose)
    if any(_holds_camera(pose) for pose in poses) and preset.placement != ("around",):
        return Drawn(camera, (), 0, (), "camera_inside")
    return Drawn(camera, tuple(poses), num_clutter, tuple(planes))


def _place(
    preset: Preset,
    item: Item,
    placement: Placement,
    target: Float[np.ndarray, "3"],
    up: Float[np.ndarray, "3"],
    rng: np.random.Generator,
) -> Pose:
    if placement == "around":
        return _around(preset, item, rng)
    if placement == "free":
        return _free(preset.spread, item, target, rng)
    # On the ground: two directions along it.
    first = np.array([1.0, 0.0, 0.0])
    second = _cross(up, first)
    aside, ahead = rng.uniform(-preset.spread, preset.spread, 2)
    foot = target + aside * first + ahead * second
    turn = rng.uniform(0, 2 * np.pi)
    level = np.cos(turn) * first + np.sin(turn) * second
    if placement == "lying":
        return Pose(item, foot + up * item.radius, _frame(level, rng))
    lean = np.radians(rng.uniform(0, preset.tilt)) if preset.tilt else 0.0
    axis = np.cos(lean) * up + np.sin(lean) * level
    return Pose(item, foot + axis * (item.height / 2), _frame(axis, rng))


def _free(
    spread: float, item: Item, target: Float[np.ndarray, "3"], rng: np.random.Generator
) -> Pose:
    """In any direction, the center in a cube around the target."""
    center = target + rng.uniform(-spread, spread, 3)
    return Pose(item, center, _frame(_direction(rng), rng))


def _around(preset: Preset, item: Item, rng: np.random.Generator) -> Pose:
    """A pipe around the camera, which is at least a quarter radius from its wall."""
    lean, turn = np.radians(rng.uniform(0, preset.tilt)), rng.uniform(0, 2 * np.pi)
    axis = np.array(
        [np.sin(lean) * np.cos(turn), np.sin(lean) * np.sin(turn), np.cos(lean)]
    )
    rotation = _frame(axis, rng)
    radius, angle = (
        0.75 * item.radius * np.sqrt(rng.random()),
        rng.uniform(0, 2 * np.pi),
    )
    aside = rotation[:, 0] * np.cos(angle) + rotation[:, 1] * np.sin(angle)
    along = rng.uniform(0.1, 0.4) * item.height
    return Pose(item, radius * aside + along * axis, rotation)


def _direction(rng: np.random.Generator) -> Float[np.ndarray, "3"]:
    """Evenly over the sphere."""
    z, turn = rng.uniform(-1, 1), rng.uniform(0, 2 * np.pi)
    across = np.sqrt(1 - z * z)
    return np.array([across * np.cos(turn), across * np.sin(turn), z])


def _frame(
    axis: Float[np.ndarray, "3"], rng: np.random.Generator
) -> Float[np.ndarray, "3 3"]:
    """Rotation whose z is the axis, with any turn about it."""
    smallest = np.eye(3)[np.argmin(np.abs(axis))]
    first = _cross(axis, smallest)
    first /= np.linalg.norm(first)
    second = _cross(axis, first)
    turn = rng.uniform(0, 2 * np.pi)
    x = np.cos(turn) * first + np.sin(turn) * second
    return np.stack([x, _cross(axis, x), axis], axis=1)


def _cross(
    a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"]:
    """Cross product; NumPy's takes 0.2 ms for a single one."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def _apart(one: Pose, other: Pose) -> bool:
    """Whether two cylinders surely do not touch: the capsules around them do not."""
    reach = one.item.radius + other.item.radius + GAP
    return _distance_of_axes(one, other) > reach


def _holds_camera(pose: Pose) -> bool:
    """Whether the camera is in a cylinder, or nearer to it than the gap."""
    along = pose.center @ pose.axis
    across = np.linalg.norm(pose.center - along * pose.axis)
    return bool(
        abs(along) < pose.item.height / 2 + GAP and across < pose.item.radius + GAP
    )


def _distance_of_axes(one: Pose, other: Pose) -> float:
    """Smallest distance of two cylinders' axes, from end to end.

    References:
        Ericson (2005), "Real-Time Collision Detection", section 5.1.9.
    """
    d1, d2 = (pose.axis * pose.item.height for pose in (one, other))
    r = (one.center - d1 / 2) - (other.center - d2 / 2)
    a, e, b = d1 @ d1, d2 @ d2, d1 @ d2
    c, f = d1 @ r, d2 @ r
    across = a * e - b * b
    s = float(np.clip((b * f - c * e) / across, 0, 1)) if across > 0 else 0.0
    t = (b * s + f) / e
    if not 0 <= t <= 1:
        t = float(np.clip(t, 0, 1))
        s = float(np.clip((b * t - c) / a, 0, 1))
    return float(np.linalg.norm(r + s * d1 - t * d2))
