"""Labels of one image, as BOP records and as exact cylinders."""

__all__ = ["camera_label", "cylinders_label", "pose_labels", "visibility_labels"]

from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, UInt16

from data_synth.draw import Drawn
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.camera.pixels import PixelBox
from impostor_jax.io.camera_file import FiledCamera, camera_record
from impostor_jax.opencv import cv2

NO_BOX = [-1, -1, -1, -1]
"""What BOP's toolkit writes for a box of nothing."""


def camera_label(
    camera: FiledCamera,
    depth_scale_mm: float,
    camera_from_world: Float[np.ndarray, "4 4"] | None,
) -> dict[str, Any]:
    """Of `scene_camera.json`: the matrix row by row; the lens is in the cylinders'.

    A scanner has no matrix; its angles are there, too. A pose, which an image of a
    sequence has, is in millimeters.
    """
    label: dict[str, Any] = {"depth_scale": depth_scale_mm}
    if isinstance(camera, PinholeCamera):
        label["cam_K"] = camera.matrix().ravel().tolist()
    if camera_from_world is not None:
        label["cam_R_w2c"] = camera_from_world[:3, :3].ravel().tolist()
        label["cam_t_w2c"] = (1e3 * camera_from_world[:3, 3]).tolist()
    return label


def pose_labels(scene: Drawn) -> list[dict[str, Any]]:
    """Of `scene_gt.json`: poses of the meshes in the camera's frame, in millimeters."""
    return [
        {
            "cam_R_m2c": pose.rotation.ravel().tolist(),
            "cam_t_m2c": (1e3 * pose.center).tolist(),
            "obj_id": pose.item.number,
        }
        for pose in scene.poses
    ]


def visibility_labels(
    silhouettes: Bool[np.ndarray, "n h w"],
    visible: Bool[np.ndarray, "n h w"],
    whole_counts: Int[np.ndarray, " n"],
    boxes: list[PixelBox],
    reading: UInt16[np.ndarray, "h w"],
) -> list[dict[str, Any]]:
    """Of `scene_gt_info.json`, with boxes as x, y, width and height.

    Args:
        silhouettes: Each cylinder as if nothing hid it.
        visible: What is seen of each.
        whole_counts: Pixels of each in the image and a margin of its own size.
        boxes: Of these pixels.
        reading: 0 where there is none.
    """
    labels = []
    for k, box in enumerate(boxes):
        count, seen = int(whole_counts[k]), int(np.count_nonzero(visible[k]))
        box_seen = list(cv2.boundingRect(visible[k].view(np.uint8)))
        labels.append(
            {
                "bbox_obj": _box_label(box),
                "bbox_visib": box_seen if seen else NO_BOX,
                "px_count_all": count,
                "px_count_valid": int(np.count_nonzero(silhouettes[k] & (reading > 0))),
                "px_count_visib": seen,
                "visib_fract": seen / count if count else 0.0,
            }
        )
    return labels


def cylinders_label(
    scene: Drawn, camera: FiledCamera, with_scenery: bool
) -> dict[str, Any]:
    """Of `scene_cylinders.json`: cylinders, planes and camera in meters and pixels.

    Args:
        scene: What is there.
        camera: What sees it.
        with_scenery: Whether scenery is listed: arguments of primitives, for each of
            one or of a batch of them.
    """
    cylinders = [
        {
            "obj_id": pose.item.number,
            "center_m": pose.center.tolist(),
            "axis": pose.axis.tolist(),
            "radius_m": pose.item.radius,
            "height_m": pose.item.height,
            "is_clutter": k >= len(scene.poses) - scene.num_clutter,
        }
        for k, pose in enumerate(scene.poses)
    ]
    planes = [
        {"point_m": point.tolist(), "normal": normal.tolist()}
        for point, normal in scene.planes
    ]
    label = {"camera": camera_record(camera), "cylinders": cylinders, "planes": planes}
    if with_scenery:
        label["scenery"] = [thing.record() for thing in scene.scenery]
    return label


def _box_label(box: PixelBox) -> list[Any]:
    if box.last_row < box.first_row:
        return NO_BOX
    width, height = box.last_col - box.first_col + 1, box.last_row - box.first_row + 1
    return [box.first_col, box.first_row, width, height]
