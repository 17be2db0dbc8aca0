"""Poses of cylinders: anywhere, on a table, on each other, or around the camera."""

__all__ = [
    "GAP",
    "Pose",
    "are_capsules_apart",
    "free_pose",
    "ground_frame",
    "holds_camera",
    "placed",
    "stacked",
]

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from data_synth.catalogue import Item
from data_synth.preset import Placement, Preset
from data_synth.solid import Point, Solid, across_to
from impostor_jax.primitives.cylinder import Cylinder

GAP = 0.002
"""Least distance of things that do not touch, in meters."""


@dataclasses.dataclass(frozen=True)
class Pose(Solid):
    """One cylinder of an image, in the camera's frame.

    Attributes:
        item: Its size.
        center: In meters.
        rotation: From the mesh's frame, whose z is the axis.
    """

    item: Item
    center: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3 3"]
    primitive = Cylinder

    @property
    def axis(self) -> Float[np.ndarray, "3"]:
        """Unit vector."""
        return self.rotation[:, 2]

    @property
    @override
    def is_convex(self) -> bool:
        return True

    @property
    @override
    def middle(self) -> Point:
        return self.center

    @property
    @override
    def reach(self) -> float:
        return float(np.hypot(self.item.radius, self.item.height / 2))

    @override
    def farthest(self, direction: Point) -> Point:
        side = np.copysign(self.item.height / 2, direction @ self.axis)
        across = across_to(self.axis, direction)
        return self.center + side * self.axis + self.item.radius * across

    @override
    def moved(self, by: Point) -> "Pose":
        return dataclasses.replace(self, center=self.center + by)

    @override
    def arguments(self) -> dict[str, Any]:
        radius, height = self.item.radius, self.item.height
        own = {"center": self.center, "axis": self.axis}
        return {**own, "radius": radius, "height": height}


def ground_frame(up: Point) -> Float[np.ndarray, "3 3"]:
    """Two directions along the ground, the first along the rows, and its normal."""
    first = np.array([1.0, 0.0, 0.0])
    return np.stack([first, _cross(up, first), up], axis=1)


def placed(
    preset: Preset,
    item: Item,
    placement: Placement,
    target: Float[np.ndarray, "3"],
    up: Float[np.ndarray, "3"],
    rng: np.random.Generator,
) -> Pose:
    """A pose of one of the ways; "stacked" is where nothing is to stand on."""
    if placement == "around":
        return _around(preset, item, rng)
    if placement == "surrounding":
        return _surrounding(preset, item, target, up, rng)
    if placement == "free":
        return free_pose(preset.spread, item, target, rng)
    first, second, _ = ground_frame(up).T
    aside, ahead = rng.uniform(-preset.spread, preset.spread, 2)
    foot = target + aside * first + ahead * second
    turn = rng.uniform(0, 2 * np.pi)
    level = np.cos(turn) * first + np.sin(turn) * second
    if placement == "lying":
        return Pose(item, foot + up * item.radius, _frame(level, rng))
    return _upright(preset, item, foot, up, level, rng)


def stacked(item: Item, below: Pose, up: Point, rng: np.random.Generator) -> Pose:
    """On the upper end of an upright one, the axis aside by a third of a radius."""
    turned = _frame(up, rng)
    most = min(item.radius, below.item.radius) / 3
    aside = turned[:, 0] * rng.uniform(0, most)
    lift = (below.item.height + item.height) / 2
    return Pose(item, below.center + lift * up + aside, turned)


def free_pose(
    spread: float, item: Item, target: Float[np.ndarray, "3"], rng: np.random.Generator
) -> Pose:
    """In any direction, the center in a cube around the target."""
    center = target + rng.uniform(-spread, spread, 3)
    return Pose(item, center, _frame(_direction(rng), rng))


def _surrounding(
    preset: Preset, item: Item, target: Point, up: Point, rng: np.random.Generator
) -> Pose:
    """Upright on the ground, in any direction from the target."""
    first, second, _ = ground_frame(up).T
    away, lean = rng.uniform(0, 2 * np.pi, 2)
    foot = target + preset.distance.draw(rng) * (
        np.cos(away) * first + np.sin(away) * second
    )
    level = np.cos(lean) * first + np.sin(lean) * second
    return _upright(preset, item, foot, up, level, rng)


def _upright(
    preset: Preset,
    item: Item,
    foot: Point,
    up: Point,
    level: Point,
    rng: np.random.Generator,
) -> Pose:
    """On its foot, leaning in a level direction as far as the preset lets it."""
    lean = np.radians(rng.uniform(0, preset.tilt)) if preset.tilt else 0.0
    axis = np.cos(lean) * up + np.sin(lean) * level
    return Pose(item, foot + axis * (item.height / 2), _frame(axis, rng))


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


def are_capsules_apart(one: Pose, other: Pose) -> bool:
    """Whether two cylinders surely do not touch: the capsules around them do not."""
    reach = one.item.radius + other.item.radius + GAP
    return _distance_of_axes(one, other) > reach


def holds_camera(pose: Pose) -> bool:
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
