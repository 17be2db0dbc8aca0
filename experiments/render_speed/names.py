"""The names of what is measured, in results.json and in the tables."""

__all__ = ["FIRST", "GROUPS", "RATIOS"]

from typing import NamedTuple

from experiments.timing import WARM_UP


class CaseGroup(NamedTuple):
    """Cases that are timed in turns.

    Attributes:
        title: In tables.
        labels: By the name of the case.
        share: Of the run's repeats.
        warm_up: Calls before each block that do not count.
    """

    title: str
    labels: dict[str, str]
    share: float
    warm_up: int


class Ratio(NamedTuple):
    """Time of a case over that of another.

    Attributes:
        label: In the table.
        top: Group and case.
        bottom: Group and case.
        wanted: The largest that is wanted; None where nothing is asked.
        scale: Divides the ratio: how many times as much work the first does.
    """

    label: str
    top: str
    bottom: str
    wanted: float | None = None
    scale: float = 1.0


_CAN = {
    "c_vectors": "C, normals as vectors",
    "c_planes": "C, normals as planes",
    "frame": "render",
    "depth": "render, depth alone",
    "tile": "render on a tile",
    "opengl": "OpenGL (llvmpipe), read back",
    "mitsuba": "Mitsuba",
    "open3d": "Open3D, mesh",
}

_LOSS = {
    "numpy": "NumPy",
    "c_loss": "C: loss and gradient",
    "loss_tile": "loss and gradient on a tile",
    "loss_own_tile": "loss and gradient, tile placed inside",
    "loss_frame": "loss and gradient, whole image",
}

_SCENE = {
    "c": "C",
    "scene": "render",
    "opengl": "OpenGL (llvmpipe), read back",
    "mitsuba": "Mitsuba",
    "open3d": "Open3D, mesh",
}

GROUPS = {
    "can640": CaseGroup("a can at 640x480", _CAN | _LOSS, 1.0, WARM_UP),
    "can1920": CaseGroup("a can at 1920x1080", _CAN, 0.5, WARM_UP),
    "scene100": CaseGroup("100 cylinders", _SCENE, 0.25, 1),
    "scene1000": CaseGroup(
        "1000 cylinders", _SCENE | {"mixed": "render, mixed shapes"}, 0.1, 1
    ),
    "scene10000": CaseGroup("10000 cylinders", _SCENE, 0.05, 1),
}
"""By name; scenes are named for their number of cylinders."""

RATIOS = {
    "frame": Ratio(
        "depth, normal, mask: render / C", "can640.frame", "can640.c_vectors", 4
    ),
    "depth": Ratio(
        "depth alone / C with normals as planes", "can640.depth", "can640.c_planes", 3
    ),
    "tile": Ratio("tile / C's whole image", "can640.tile", "can640.c_vectors", 0.9),
    "loss": Ratio(
        "loss and gradient on a tile / C's on the whole image",
        "can640.loss_tile",
        "can640.c_loss",
        0.8,
    ),
    "loss_to_frame": Ratio(
        "loss and gradient on a tile / C's image",
        "can640.loss_tile",
        "can640.c_vectors",
        0.8,
    ),
    "frame_1920": Ratio("1920x1080: render / C", "can1920.frame", "can1920.c_vectors"),
    "depth_1920": Ratio(
        "1920x1080: depth alone / C with planes", "can1920.depth", "can1920.c_planes"
    ),
    "tile_1920": Ratio(
        "1920x1080: tile / C's whole image", "can1920.tile", "can1920.c_vectors"
    ),
    "scene_100": Ratio("100 cylinders: render / C", "scene100.scene", "scene100.c"),
    "scene_1000": Ratio("1000 cylinders: render / C", "scene1000.scene", "scene1000.c"),
    "scene_10000": Ratio(
        "10000 cylinders: render / C", "scene10000.scene", "scene10000.c", 10
    ),
    "open3d": Ratio(
        "10000 cylinders: render / Open3D", "scene10000.scene", "scene10000.open3d", 1
    ),
    "mitsuba": Ratio(
        "10000 cylinders: render / Mitsuba", "scene10000.scene", "scene10000.mitsuba", 1
    ),
    "per_cylinder": Ratio(
        "time per cylinder: of 10000 / of 100",
        "scene10000.scene",
        "scene100.scene",
        1,
        scale=100,
    ),
}
"""By name."""

FIRST = {
    "empty": "first render of a process, empty cache",
    "filled": "first render of a process, filled cache",
}
"""First calls by what the folder of compiled programs holds."""
