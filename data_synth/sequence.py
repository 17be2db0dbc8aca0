"""Videos: a drawn scene in which the camera, cylinders and what hides them move.

The first image of a sequence is drawn and keeps the rules as any other does; the others
show the same things a little later. The camera turns to and fro about the upright line
through the cylinders. Some of those that stand there go along the ground and come back,
unless they would touch something. Clutter goes to and fro before them.
"""

__all__ = ["FRAME_RATE", "Motion", "check_can_move", "draw_motion"]

import dataclasses

import numpy as np
from jaxtyping import Float

from data_synth.camera_draw import ScannerDraw
from data_synth.draw import Drawn
from data_synth.pose import GAP, ground_frame
from data_synth.preset import Preset
from data_synth.solid import Point
from impostor_jax.io.pose_file import rigid

FRAME_RATE = 30.0
"""Images in a second."""

MOVING = 0.5
"""Share of the cylinders that move, if they can."""

TURN_DEG = 4.0, 12.0
"""Largest angle by which a camera turns to either side, drawn evenly, in degrees."""

WAY = 0.04, 0.12
"""Length of a cylinder's way along the ground, in meters."""

SWEEP = 0.1, 0.3
"""The same of clutter to either side."""

PERIOD = 3.0, 6.0
"""Seconds from a beginning to the next of what goes to and fro."""


@dataclasses.dataclass(frozen=True)
class Motion:
    """How a scene and the camera that sees it move.

    Attributes:
        scene: At the beginning, in the camera's frame of then, which is the world.
        up: Direction about which the camera turns.
        pivot: Point about which it does.
        angle: By which it does, in radians.
        ways: Where each cylinder goes to, from where it was.
        periods: Seconds after which each of them is back, and the camera's last.
    """

    scene: Drawn
    up: Point
    pivot: Point
    angle: float
    ways: Float[np.ndarray, "n 3"]
    periods: Float[np.ndarray, " m"]

    def camera_from_world(self, seconds: float) -> Float[np.ndarray, "4 4"]:
        """Pose of the camera after some time."""
        angle = self.angle * np.sin(2 * np.pi * seconds / self.periods[-1])
        x, y, z = self.up
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        return rigid(turn, self.pivot - turn @ self.pivot)

    def offsets(self, seconds: float) -> Float[np.ndarray, "n 3"]:
        """How far each cylinder is from where it was, in the world."""
        phase = 2 * np.pi * seconds / self.periods[:-1]
        bound = np.arange(len(phase)) < len(phase) - self.scene.num_clutter
        part = np.where(bound, (1 - np.cos(phase)) / 2, np.sin(phase))
        return part[:, None] * self.ways

    def after(self, seconds: float) -> Drawn:
        """The scene after some time, in the camera's frame of then."""
        pose = self.camera_from_world(seconds)
        turn, by = pose[:3, :3], pose[:3, 3]
        poses = tuple(
            dataclasses.replace(
                one,
                center=turn @ (one.center + offset) + by,
                rotation=turn @ one.rotation,
            )
            for one, offset in zip(self.scene.poses, self.offsets(seconds), strict=True)
        )
        planes = tuple(
            (turn @ point + by, turn @ normal) for point, normal in self.scene.planes
        )
        scenery = tuple(thing.transformed(turn, by) for thing in self.scene.scenery)
        return dataclasses.replace(
            self.scene, poses=poses, planes=planes, scenery=scenery
        )


def check_can_move(preset: Preset) -> None:
    """Raise a `ValueError` where no sequence can be made of a preset's scenes."""
    if isinstance(preset.camera, ScannerDraw) or preset.placement == ("around",):
        raise ValueError(
            "sequence must be None for a scanner and for a pipe around the camera"
        )
    if preset.appearance is not None:
        raise ValueError("sequence must be None for images in color")


def draw_motion(scene: Drawn, is_on_ground: bool, rng: np.random.Generator) -> Motion:
    """Draw how a scene moves.

    Args:
        scene: At the beginning.
        is_on_ground: Whether its first plane is the ground.
        rng: Of all that is drawn.
    """
    count, bound = len(scene.poses), len(scene.poses) - scene.num_clutter
    up = scene.planes[0][1] if is_on_ground else np.array([0.0, -1.0, 0.0])
    frame = ground_frame(up)
    centers = [pose.center for pose in scene.poses[:bound]]
    pivot = np.mean(centers, axis=0) if bound else np.array([0.0, 0.0, 1.0])
    ways = np.zeros((count, 3))
    for k in range(count):
        turn, moves = rng.uniform(0, 2 * np.pi), rng.random() < MOVING
        if k >= bound:
            ways[k, 0] = rng.uniform(*SWEEP)
            continue
        way = np.cos(turn) * frame[:, 0] + np.sin(turn) * frame[:, 1]
        way *= rng.uniform(*WAY)
        if moves and _is_free(scene, k, way, ways):
            ways[k] = way
    angle = np.radians(rng.uniform(*TURN_DEG)) * (1 if rng.random() < 0.5 else -1)
    periods = rng.uniform(*PERIOD, count + 1)
    return Motion(scene, up, pivot, float(angle), ways, periods)


def _is_free(
    scene: Drawn, number: int, way: Point, ways: Float[np.ndarray, "n 3"]
) -> bool:
    """Whether a cylinder touches nothing on its way, wherever others are on theirs."""
    own = scene.poses[number]
    middle, reach = own.center + way / 2, own.reach + np.linalg.norm(way) / 2
    others = [
        (pose.middle + ways[k] / 2, pose.reach + np.linalg.norm(ways[k]) / 2)
        for k, pose in enumerate(scene.poses[: len(scene.poses) - scene.num_clutter])
        if k != number
    ]
    others += [(thing.middle, thing.reach) for thing in scene.scenery]
    return all(
        np.linalg.norm(middle - place) > reach + size + GAP for place, size in others
    )
