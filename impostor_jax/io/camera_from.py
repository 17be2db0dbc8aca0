"""Cameras of other programs."""

__all__ = ["camera_from"]

from typing import Any

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.io.foreign_camera import camera_arguments, camera_pose


def camera_from(
    camera: Any, size: Any = None, *, camera_from_world: Any = None
) -> PinholeCamera:
    """Make a camera of another program's, which is told by its fields.

    The program need not be installed. Principal points are moved to where this package
    has them, the center of the first pixel at 0: those of COLMAP and PyTorch3D by half
    a pixel. Lenses are
    converted where OpenCV's models hold them exactly, and refused otherwise.

    Give the camera that took the depth. Many drivers deliver depth that is aligned to a
    color camera (`rs.align`, `aligned_depth_to_color`, `depth_registered`), which makes
    walls lean outward (see `AlignedDepth`); where the native image can be had, take
    that, and the intrinsics of the depth stream.

    Args:
        camera: One of these, or a mapping with the same names, such as their JSON or
            YAML:

            - `open3d.camera.PinholeCameraIntrinsic`, as Open3D's clouds of depth
              images use it; of one made for its cast rays, take off half a pixel.
            - `sensor_msgs/CameraInfo` of ROS 1 or 2, or the YAML of a calibration, with
              the raw K and a lens of `plumb_bob`, `rational_polynomial` or
              `equidistant`. Images that were binned or cropped are refused. Of
              rectified images give the left 3 x 3 of P as a matrix.
            - `pyrealsense2.intrinsics`, of `none`, `brown_conrady`, `kannala_brandt4`,
              and, without tangential terms, `modified_` and `inverse_brown_conrady`.
            - `pycolmap.Camera`, or a line of `cameras.txt`: SIMPLE_PINHOLE, PINHOLE,
              SIMPLE_RADIAL, RADIAL, OPENCV, OPENCV_FISHEYE or FULL_OPENCV.
            - `pytorch3d.renderer.PerspectiveCameras`, one of them, in normalized device
              coordinates or (`in_ndc` false) in pixels: `focal_length`,
              `principal_point`, `image_size` (height and width), and `R` and `T` of its
              pose. Without these the camera frame is this package's, with x right and
              y down.
            - A matrix K, (3, 3), in OpenCV's pixels.
        size: Width and height in pixels, of a matrix K, or of a camera of PyTorch3D
            that has no `image_size`.
        camera_from_world: Pose, as `PinholeCamera` takes it; in place of R and T.

    Raises:
        ValueError: It is none of these, or what it says cannot be had exactly.
    """
    arguments = camera_arguments(camera, size)
    pose = camera_pose(camera) if camera_from_world is None else camera_from_world
    return PinholeCamera(**arguments, camera_from_world=pose)
