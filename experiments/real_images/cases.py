"""Real depth images of cans of known size: which there are, and how they are read."""

__all__ = ["CASES", "FILE", "Case", "cases_in", "drawn_case"]

import dataclasses
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import impostor_jax as ij
from experiments.scenes import Image, Mask
from experiments.sensor_models.scenes import SENSORS, draw_image
from impostor_jax.io.atomic import write_text
from impostor_jax.io.camera_file import pinhole_of, read_camera, write_camera
from impostor_jax.io.depth_image import (
    read_depth,
    read_mask,
    write_depth_png,
    write_mask,
)
from impostor_jax.io.json_file import check_keys, read_json_object
from impostor_jax.sensor.base import AbstractDepthNoise

FILE = "cases.json"
"""Lists the cases of a folder, each with the fields of `Case`, under "cases"."""


@dataclasses.dataclass(frozen=True)
class Case:
    """A can in an image; paths are in the folder.

    Attributes:
        name: Of the object.
        depth: Depth image.
        mask: Pixels of the object, or some of them.
        camera: Camera file.
        radius: Of the can, in meters.
        sensor: "structured_light" or "stereo".
        native_scale: Pixels of the image for one of the sensor's.
        reference: Where the radius is from.
        mouth: Corners (u, v) of pixels that show the bore of a mug; none of a can.
    """

    name: str
    depth: str
    mask: str
    camera: str
    radius: float
    sensor: str
    native_scale: float = 1.0
    reference: str = ""
    mouth: tuple[tuple[int, int], ...] = ()

    def read(self, folder: Path) -> tuple[Image, Mask, ij.PinholeCamera]:
        """Depth in meters, mask and camera."""
        camera, scale = read_camera(folder / self.camera)
        depth = read_depth(folder / self.depth, scale)
        return depth, read_mask(folder / self.mask), pinhole_of(camera, self.camera)

    def with_mouth(self, mask: Mask) -> Mask:
        """A mask and the pixels that show the bore."""
        filled = mask.astype(np.uint8)
        cv2.fillPoly(filled, [np.array(self.mouth, np.int32)], [1])
        return filled > 0

    def sensors(
        self, camera: ij.PinholeCamera
    ) -> tuple[AbstractDepthNoise, AbstractDepthNoise]:
        """The whole camera, and the noise of its single readings alone."""
        if self.sensor == "stereo":
            focal = float(camera.fx) / self.native_scale
            whole = ij.StereoDisparity.sensor(focal, native_scale=self.native_scale)
            return whole, ij.StereoDisparity(focal)
        return ij.StructuredLight.sensor(self.native_scale), ij.StructuredLight()


YCB = {
    "depth": "ycb_table/depth.png",
    "camera": "ycb_table/camera.json",
    "sensor": "structured_light",
    # Depth was warped to a color image of this focal length.
    "native_scale": 1066.8 / 567.6,
    "reference": "published scan of the YCB object",
}
CASES = (
    Case("coffee can", mask="ycb_table/mask_master_chef_can.png", radius=0.0498, **YCB),
    Case(
        "soup can, lying", mask="ycb_table/mask_soup_can_lying.png", radius=0.033, **YCB
    ),
    Case(
        "stereo mug",
        depth="stereo_mug/depth.tiff",
        mask="stereo_mug/mask_mug.png",
        camera="stereo_mug/camera.json",
        radius=0.0396,
        sensor="stereo",
        reference="printed by a tutorial of PCL",
        mouth=(
            *((356, 272), (358, 256), (370, 245), (388, 241), (410, 241), (428, 248)),
            *((438, 262), (430, 280), (415, 288), (390, 291), (370, 287), (358, 280)),
        ),
    ),
)
"""Of images that others have published: demo image 000002 of PoseCNN (MIT) and PCL's
table_scene_mug_stereo_textured (BSD), with masks of the wall drawn by hand."""


def cases_in(folder: Path) -> list[Case]:
    """Those of `CASES` whose files a folder holds, and those that its own file lists.

    Raises:
        ValueError: The file is broken, or there are none.
    """
    cases = [case for case in CASES if (folder / case.depth).exists()]
    listed = folder / FILE
    if listed.exists():
        record = read_json_object(listed, f"case file {str(listed)!r}")
        cases += [_case_of(one) for one in record.get("cases", [])]
    if not cases:
        raise ValueError(f"folder must hold known images or {FILE}, got {folder}")
    return cases


def _case_of(record: dict[str, Any]) -> Case:
    fields = dataclasses.fields(Case)
    required = [one.name for one in fields if one.default is dataclasses.MISSING]
    check_keys(record, required, [one.name for one in fields], FILE)
    return Case(**record)


def drawn_case(folder: Path) -> None:
    """Write a folder whose only image is drawn, for a trial of the code."""
    image = draw_image(SENSORS["structured_light"].whole, 0, 0)
    write_camera(folder / "camera.json", image.camera, 1e-4)
    write_depth_png(folder / "depth.png", image.depth, 1e-4)
    write_mask(folder / "mask.png", image.mask[0])
    assert isinstance(image.shapes, ij.Cylinder)
    case = Case(
        "drawn can",
        depth="depth.png",
        mask="mask.png",
        camera="camera.json",
        radius=float(image.shapes.radius[0]),
        sensor="structured_light",
    )
    write_text(folder / FILE, json.dumps({"cases": [dataclasses.asdict(case)]}))
