"""Cameras of other programs, told by their fields, as arguments of `PinholeCamera`.

None of the programs is needed, and neither is JAX. Three things differ between them:

- The principal point. OpenCV, ROS and RealSense have the center of the first pixel at
  0, as this package has. Open3D's clouds of depth images have, too, though its cast
  rays go through centers at 0.5. COLMAP has it at 0.5, which is taken off here,
  and so has PyTorch3D: its normalized device coordinates end with the image.
- The lens. What OpenCV's models hold exactly is converted; all else is refused.
- The camera frame. That of PyTorch3D has x left and y up, and a pose goes with it.

References:
    ROS: sensor_msgs/CameraInfo and distortion_models.hpp, and
    camera_calibration_parsers for YAML. RealSense: projection.md and rsutil.h of
    librealsense, and pyrealsense2 2.59 for what its models compute. COLMAP: "Camera
    Models" and "Output Format" of its documentation, models.h, and pycolmap 4.2.
    Open3D: `create_from_depth_image` and `create_rays_pinhole` of 0.20. PyTorch3D:
    "Cameras" of its notes, and `cameras.py` of 0.7.
"""

__all__ = ["camera_arguments", "camera_pose"]

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from impostor_jax.io.pose_file import rigid
from impostor_jax.plain_arguments import one_of

KINDS = (
    "an intrinsic of Open3D, a CameraInfo of ROS, intrinsics of RealSense, a camera of "
    "COLMAP, PerspectiveCameras of PyTorch3D, or a matrix K with a size"
)

Arguments = dict[str, Any]


def camera_arguments(given: Any, size: Any = None) -> Arguments:
    """Arguments of `PinholeCamera`, but the pose, of another program's camera.

    Args:
        given: The camera: an object, a mapping with the same names, a line of COLMAP's
            `cameras.txt`, or a matrix K.
        size: Width and height in pixels; of a matrix K, of a camera of PyTorch3D that
            has no `image_size`, and of nothing else.

    Raises:
        ValueError: It is none of these, or what it says cannot be had exactly.
    """
    kind = _kind(given)
    if kind in (_of_matrix, _of_pytorch3d):
        return kind(given, size)
    if size is not None:
        raise ValueError(
            f"size must be given with a matrix K alone, got {size!r}: a camera has its "
            "own"
        )
    return kind(given)


def camera_pose(given: Any) -> np.ndarray | None:
    """`camera_from_world`, (4, 4), of a camera that holds a pose; None of others.

    Args:
        given: A camera that `camera_arguments` takes.
    """
    if _kind(given) is not _of_pytorch3d or not (_has(given, "R") and _has(given, "T")):
        return None
    rotation = _single("R", _get(given, "R"), (3, 3))
    # It multiplies row vectors.
    pose = rigid(rotation.T, _single("T", _get(given, "T"), (3,)))
    return np.diag([-1.0, -1.0, 1.0, 1.0]) @ pose


def _kind(given: Any) -> Callable[..., Arguments]:
    """What converts a camera, told by its fields."""
    if isinstance(given, str):
        return _of_colmap_line
    kinds: list[tuple[tuple[str, ...], Callable[..., Arguments]]] = [
        (("intrinsic_matrix", "width", "height"), _of_open3d),
        (("ppx", "ppy", "model", "coeffs"), _of_realsense),
        (("model", "params", "width", "height"), _of_colmap),
        (("camera_matrix", "image_width", "image_height"), _of_ros),
        (("k", "d", "distortion_model"), _of_ros),
        (("K", "D", "distortion_model"), _of_ros),
        (("focal_length", "principal_point"), _of_pytorch3d),
    ]
    for names, convert in kinds:
        if all(_has(given, name) for name in names):
            return convert
    if isinstance(given, Mapping) or np.shape(_numbers("camera", given)) != (3, 3):
        raise ValueError(f"camera must be {KINDS}, got {_shown(given)}")
    return _of_matrix


def _of_matrix(given: Any, size: Any) -> Arguments:
    if size is None:
        raise ValueError("size must be given with a matrix K: width and height")
    width, height = _numbers("size", size, 2)
    return {**_intrinsics(given), "width": _whole(width), "height": _whole(height)}


def _of_open3d(given: Any) -> Arguments:
    matrix = _get(given, "intrinsic_matrix")
    return {**_intrinsics(_square(matrix, by_columns=True)), **_size(given)}


def _of_ros(given: Any) -> Arguments:
    """A message, of ROS 1 or 2, or what YAML holds of it."""
    _refuse_cropped(given)
    matrix = _first(given, "k", "K", "camera_matrix")
    coefficients = _first(given, "d", "D", "distortion_coefficients")
    width, height = _ros_size(given)
    model = _get(given, "distortion_model") if _has(given, "distortion_model") else ""
    numbers = _numbers("distortion coefficients", _data(coefficients)).ravel()
    # Old files of calibrations have no name, and uncalibrated cameras an empty one.
    model = model or "plumb_bob"
    if model in ("equidistant", "fisheye"):
        lens = _lens(numbers, (4,), model) | {"fisheye": True}
    elif model == "plumb_bob":
        lens = _lens(numbers, (0, 4, 5), model)
    elif model == "rational_polynomial":
        lens = _lens(numbers, (0, 4, 5, 8, 12, 14), model)
    else:
        raise ValueError(
            "distortion_model must be plumb_bob, rational_polynomial or equidistant, "
            f"got {model!r}"
        )
    intrinsics = _intrinsics(_square(_data(matrix)))
    return {**intrinsics, "width": width, "height": height, **lens}


def _ros_size(given: Any) -> tuple[Any, Any]:
    width = _first(given, "width", "image_width")
    return width, _first(given, "height", "image_height")


def _refuse_cropped(given: Any) -> None:
    """Raise where an image is smaller than the calibrated one that K is of."""
    for name in ("binning_x", "binning_y"):
        # 0 means 1.
        if _has(given, name) and _get(given, name) not in (0, 1):
            raise ValueError(
                f"{name} must be 0 or 1, got {_get(given, name)}: K is of the "
                "image without binning"
            )
    if not _has(given, "roi"):
        return
    roi, whole = _get(given, "roi"), _ros_size(given)
    place = [_get(roi, n) for n in ("x_offset", "y_offset", "width", "height")]
    # All zero, or the whole image, mean that nothing is cut off.
    if any(place) and tuple(place) != (0, 0, *whole):
        raise ValueError(
            f"roi must be the whole image, got {place}: K is of the image that is not "
            "cropped"
        )


def _of_realsense(given: Any) -> Arguments:
    model = _name(_get(given, "model"))
    numbers = _numbers("coeffs", _get(given, "coeffs"), 5)
    lens: Arguments = {}
    if model == "kannala_brandt4":
        lens = {"distortion": numbers[:4].tolist(), "fisheye": True}
    elif model in ("modified_brown_conrady", "inverse_brown_conrady"):
        # Both shift what the radial terms have moved already, where OpenCV's model
        # shifts what they have not; without the shift all three are one.
        if numbers[2:4].any():
            raise ValueError(
                f"coeffs of {model} must have no tangential terms, got "
                f"{numbers.tolist()}: no model of OpenCV's has them as RealSense has"
            )
        lens = {"distortion": numbers.tolist()}
    elif model == "brown_conrady":
        lens = {"distortion": numbers.tolist()}
    elif model != "none":
        raise ValueError(
            "model must be none, brown_conrady, modified_brown_conrady, "
            f"inverse_brown_conrady or kannala_brandt4, got {model!r}"
        )
    focal = {"fx": _get(given, "fx"), "fy": _get(given, "fy")}
    center = {"cx": _get(given, "ppx"), "cy": _get(given, "ppy")}
    return {**focal, **center, **_size(given), **lens}


def _of_colmap_line(line: str) -> Arguments:
    """A line of `cameras.txt`: CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]."""
    words = line.split()
    try:
        width, height = int(words[2]), int(words[3])
        params = [float(word) for word in words[4:]]
    except (IndexError, ValueError) as error:
        raise ValueError(
            "camera must be a line of COLMAP's cameras.txt (CAMERA_ID MODEL WIDTH "
            f"HEIGHT PARAMS), got {line[:80]!r}"
        ) from error
    return _of_colmap(
        {"model": words[1], "params": params, "width": width, "height": height}
    )


COLMAP: dict[str, tuple[str, ...]] = {
    "SIMPLE_PINHOLE": ("f", "cx", "cy"),
    "PINHOLE": ("fx", "fy", "cx", "cy"),
    "SIMPLE_RADIAL": ("f", "cx", "cy", "k1"),
    "RADIAL": ("f", "cx", "cy", "k1", "k2"),
    "OPENCV": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
    "OPENCV_FISHEYE": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
    "FULL_OPENCV": (
        "fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6",
    ),
}  # fmt: skip
"""Names of the parameters of COLMAP's models, of those that OpenCV has, too."""

OPENCV = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
"""Order of OpenCV's coefficients."""


def _of_colmap(given: Any) -> Arguments:
    model = _name(_get(given, "model"))
    one_of("model", model, COLMAP)
    names = COLMAP[model]
    numbers = _numbers(f"params of {model}", _get(given, "params"), len(names))
    values = dict(zip(names, numbers.tolist(), strict=True))
    fx, fy = (values.get(name, values.get("f")) for name in ("fx", "fy"))
    center = {"cx": values["cx"] - 0.5, "cy": values["cy"] - 0.5}
    lens: Arguments = {}
    if model == "OPENCV_FISHEYE":
        lens = {"distortion": [values[f"k{n}"] for n in (1, 2, 3, 4)], "fisheye": True}
    elif "k1" in values:
        count = 8 if "k4" in values else 5
        lens = {"distortion": [values.get(name, 0.0) for name in OPENCV[:count]]}
    return {"fx": fx, "fy": fy, **center, **_size(given), **lens}


def _of_pytorch3d(given: Any, size: Any) -> Arguments:
    """PerspectiveCameras, one of them: of normalized device coordinates or pixels."""
    if not _told(given, "is_perspective"):
        raise ValueError(
            "camera must be PerspectiveCameras of PyTorch3D, got "
            f"{type(given).__name__}, which are of another projection"
        )
    if _has(given, "K") and _get(given, "K") is not None:
        raise ValueError(
            "camera must have no K, but a focal_length and a principal_point"
        )
    width, height = _pytorch3d_size(given, size)
    focal = _single("focal_length", _get(given, "focal_length"), (2,), (1,), ())
    point = _single("principal_point", _get(given, "principal_point"), (2,))
    (fx, fy), (cx, cy) = np.broadcast_to(focal, (2,)).tolist(), point.tolist()
    if _told(given, "in_ndc"):
        # From -1 to 1 along the shorter side, to the left and upward.
        half = min(width, height) / 2
        fx, fy = fx * half, fy * half
        cx, cy = width / 2 - cx * half, height / 2 - cy * half
    intrinsics = {"fx": fx, "fy": fy, "cx": cx - 0.5, "cy": cy - 0.5}
    return {**intrinsics, "width": _whole(width), "height": _whole(height)}


def _pytorch3d_size(given: Any, size: Any) -> tuple[float, float]:
    if not _has(given, "image_size"):
        if size is None:
            raise ValueError(
                "size must be given with a camera without image_size: width and height"
            )
        width, height = _numbers("size", size, 2)
    elif size is not None:
        raise ValueError(
            f"size must not be given with a camera that has image_size, got {size!r}"
        )
    else:
        height, width = _single("image_size", _get(given, "image_size"), (2,))
    return width, height


def _told(given: Any, name: str) -> bool:
    """What a method, or a field, says; true where there is none."""
    if not _has(given, name):
        return True
    value = _get(given, name)
    return bool(value() if callable(value) else value)


def _single(name: str, given: Any, *shapes: tuple[int, ...]) -> np.ndarray:
    """Numbers of one of some shapes, or of a batch of one; also of a tensor."""
    tensor = getattr(given, "detach", None)
    numbers = _numbers(name, given if tensor is None else tensor().cpu())
    for shape in shapes:
        if numbers.shape in (shape, (1, *shape)):
            return numbers.reshape(shape)
    raise ValueError(
        f"{name} must be that of one camera, of shape {shapes[0]}, got the shape "
        f"{numbers.shape}"
    )


def _lens(numbers: np.ndarray, counts: Sequence[int], model: str) -> Arguments:
    """Coefficients in OpenCV's order, with zeros for those that are left out."""
    if len(numbers) not in counts:
        raise ValueError(
            f"{model} must have {', '.join(map(str, counts))} coefficients, got "
            f"{len(numbers)}"
        )
    if model in ("equidistant", "fisheye"):
        return {"distortion": numbers.tolist()}
    if not numbers.any():
        return {}
    full = next(count for count in (5, 8, 14) if count >= len(numbers))
    return {"distortion": [*numbers.tolist(), *[0.0] * (full - len(numbers))]}


def _intrinsics(given: Any) -> Arguments:
    """Of a matrix K, whose pixels must be at right angles."""
    k = _square(given)
    rest = [k[0, 1], k[1, 0], k[2, 0], k[2, 1], k[2, 2] - 1]
    if np.any(np.asarray(rest) != 0):
        raise ValueError(
            "K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], without skew, got "
            f"{k.tolist()}"
        )
    fx, fy, cx, cy = (float(k[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return {"fx": fx, "fy": fy, "cx": cx, "cy": cy}


def _square(given: Any, *, by_columns: bool = False) -> np.ndarray:
    """A matrix K of its nine numbers, if need be by columns, as Open3D's JSON is."""
    numbers = _numbers("K", given)
    if numbers.shape == (3, 3):
        return numbers
    if numbers.size != 9:
        raise ValueError(f"K must hold 9 numbers, got {numbers.size}")
    square = numbers.reshape(3, 3)
    return square.T if by_columns else square


def _numbers(name: str, given: Any, count: int | None = None) -> np.ndarray:
    try:
        numbers = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        if name == "camera":
            raise ValueError(f"camera must be {KINDS}, got {_shown(given)}") from error
        raise ValueError(f"{name} must hold numbers, got {_shown(given)}") from error
    if count is not None and numbers.shape != (count,):
        raise ValueError(f"{name} must be {count} numbers, got {_shown(given)}")
    return numbers


def _size(given: Any) -> Arguments:
    return {"width": _get(given, "width"), "height": _get(given, "height")}


def _whole(number: float) -> Any:
    """A whole number as such; another stays, and is refused where it is used."""
    return int(number) if float(number).is_integer() else number


def _data(given: Any) -> Any:
    """The numbers of a matrix of YAML, which stand beside rows and cols."""
    return given["data"] if isinstance(given, Mapping) and "data" in given else given


def _name(given: Any) -> str:
    """Name of an entry of an enumeration of pybind11's, or of its text."""
    name = getattr(given, "name", given)
    return str(name).rpartition(".")[2]


def _has(given: Any, name: str) -> bool:
    if isinstance(given, Mapping):
        return name in given
    return getattr(given, name, None) is not None


def _get(given: Any, name: str) -> Any:
    if isinstance(given, Mapping):
        if name not in given:
            raise ValueError(f"camera lacks {name}")
        return given[name]
    return getattr(given, name)


def _first(given: Any, *names: str) -> Any:
    """The value of the first of some names that there is."""
    for name in names:
        if _has(given, name):
            return _get(given, name)
    raise ValueError(f"camera lacks {names[0]}")


def _shown(given: Any) -> str:
    """What was given, in no more than a line."""
    return repr(given)[:80]
