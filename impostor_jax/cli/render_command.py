"""The command `impostor-jax render`."""

__all__ = ["RenderCommand"]

import dataclasses
import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import tyro

from impostor_jax.cli.dials import Dials, EffortName, chosen_effort
from impostor_jax.cli.ending import stream_beside
from impostor_jax.cli.inputs import check_page
from impostor_jax.io.atomic import check_output_folder, write_text
from impostor_jax.io.camera_formats import read_camera_record
from impostor_jax.io.scene_record import read_scene_record
from impostor_jax.plain_arguments import whole_number

if TYPE_CHECKING:
    from impostor_jax.effort import Effort
    from impostor_jax.io.camera_file import FiledCamera
    from impostor_jax.io.scene_file import SceneFile
    from impostor_jax.primitives.base import AbstractPrimitive
    from impostor_jax.rendering.scene import Scene

FILES = (
    "depth.png", "depth.tiff", "normal.png", "mask.png", "index.png", "camera.json",
)  # fmt: skip
"""What it writes."""

PICTURES = ("picture.png", "picture.npy")
"""What it writes where there are lights, too."""


@dataclasses.dataclass(frozen=True)
class RenderCommand:
    """Render a capped cylinder, or the shapes of a scene file.

    Writes depth.png (16 bit), depth.tiff, normal.png, mask.png, index.png (which shape
    is seen: 0 for none, then from 1) and camera.json; `fit` reads them. Where the scene
    file holds lights, also picture.png (sRGB) and picture.npy (linear RGB), with
    shadows, mirrors and glass. With --page, a page for a browser in which the picture
    is turned around with the mouse.
    """

    output: Path | None = None
    """Folder that the files are written to; may be left out with --page."""
    page: Path | None = None
    """HTML file that shows the picture in a browser with WebGL2, turned by the mouse;
    lit from the camera where the scene file holds no lights."""
    scene: tyro.conf.Positional[Path | None] = None
    """Scene file (JSON); in place of center, axis, radius and height."""
    camera: Path | None = None
    """Camera file (JSON): fx, fy, cx, cy, width, height, depth_scale_m, distortion.
    Needed where the scene file holds none."""
    center: tuple[float, float, float] | None = None
    """Midpoint of the axis in the camera frame (x right, y down, z forward), meters."""
    axis: tuple[float, float, float] | None = None
    """Direction of the axis, of any length."""
    radius: float | None = None
    """Radius in meters."""
    height: float | None = None
    """Length from cap to cap in meters."""
    bounces: int = 3
    """Most times that a ray of the picture is mirrored or bent, from 0 to 16."""
    edges: Literal["hard", "area"] = "hard"
    """A picture's edges: as the rays through pixel centers see them, or by areas."""
    effort: EffortName = "balanced"
    """How much work it takes; each dial may be set apart from it."""
    dials: Dials = dataclasses.field(default_factory=Dials)

    def run(self) -> int:
        """Run the command; returns the exit code."""
        if self.output is None and self.page is None:
            raise ValueError("--output or --page must be given")
        effort = chosen_effort(self.effort, self.dials)
        self._check_given()
        # These start JAX.
        from impostor_jax.io.camera_file import read_camera
        from impostor_jax.rendering.trace import MOST_BOUNCES

        whole_number("bounces", self.bounces, 0, MOST_BOUNCES)
        scene = self._scene()
        camera, given_scale = scene.camera, None
        if self.camera is not None:
            camera, given_scale = read_camera(self.camera)
        assert camera is not None
        self._check_outputs(scene)
        tell = partial(print, file=stream_beside(self.page))
        # What no page can show is found before anything is written.
        page = None if self.page is None else self._page_of(scene, camera)
        if self.output is not None:
            made = self._write_images(self.output, scene, camera, given_scale, effort)
            tell(made)
        if self.page is not None and page is not None:
            write_text(self.page, page)
            tell(f"{self.page} shows {self._shown(_count_of(scene))}")
        return 0

    def _check_outputs(self, scene: "SceneFile") -> None:
        """Raise unless all can be written."""
        if self.output is not None:
            files = (*FILES, *PICTURES) if scene.lights else FILES
            check_output_folder(self.output, files)
        check_page(self.page)

    def _page_of(self, scene: "SceneFile", camera: "FiledCamera") -> str:
        from impostor_jax.glsl.orbit_page import orbit_page
        from impostor_jax.io.camera_file import pinhole_of

        look = (scene.lights, scene.materials, scene.background)
        seen_by = pinhole_of(camera, "--page")
        return orbit_page(_shapes_of(scene), seen_by, *look, self.bounces)

    def _write_images(
        self,
        output: Path,
        scene: "SceneFile",
        camera: "FiledCamera",
        given_scale: float | None,
        effort: "Effort",
    ) -> str:
        """Write the maps and the picture; returns what they show."""
        import numpy as np

        from impostor_jax.io import depth_image
        from impostor_jax.io.camera_file import write_camera
        from impostor_jax.io.color_image import srgb_levels
        from impostor_jax.io.npy_file import write_npy
        from impostor_jax.rendering.render import render
        from impostor_jax.rendering.trace import trace

        outputs = ("depth", "normal", "mask", "index")
        shapes = _shapes_of(scene)
        maps = render(shapes, camera, outputs, effort=effort)
        picture = None
        if scene.lights:
            look = (scene.lights, scene.materials, scene.background)
            picture = trace(
                shapes, camera, *look, self.bounces, effort=effort, edges=self.edges
            )
        if effort.stride > 1:
            # Of a lens the rays are solved for anew, which takes its time.
            camera = camera.strided(effort.stride)
        scale = depth_image.fitting_scale(maps.depth, given_scale)
        depth_image.write_depth_png(output / "depth.png", maps.depth, scale)
        depth_image.write_depth_tiff(output / "depth.tiff", maps.depth)
        depth_image.write_normals(output / "normal.png", maps.normal)
        depth_image.write_mask(output / "mask.png", maps.mask)
        depth_image.write_index(output / "index.png", maps.index)
        if picture is not None:
            depth_image.write_image(output / "picture.png", srgb_levels(picture))
            write_npy(output / "picture.npy", np.asarray(picture, np.float32))
        write_camera(output / "camera.json", camera, scale)
        count = np.count_nonzero(np.asarray(maps.mask))
        seen = len(np.unique(np.asarray(maps.index)[np.asarray(maps.mask)]))
        shown = self._shown(f"{seen} of {_count_of(scene)}")
        return f"{count} of {camera.width * camera.height} pixels see {shown}"

    def _shown(self, count: str | int) -> str:
        return "the cylinder" if self.scene is None else f"{count} shapes"

    def _check_given(self) -> None:
        """Raise where files or flags are seen to be bad without JAX."""
        fields = self._fields()
        given = [name for name, value in fields.items() if value is not None]
        has_camera = self.camera is not None
        if self.scene is not None:
            if given:
                raise ValueError(
                    "a scene file must not be given together with "
                    f"--{', --'.join(given)}"
                )
            record = read_scene_record(self.scene)
            has_camera |= record.get("camera") is not None
        elif len(given) < len(fields):
            missing = [f"--{name}" for name in fields if name not in given]
            raise ValueError(f"a scene file or {', '.join(missing)} must be given")
        if not has_camera:
            raise ValueError(
                "camera must be given: a camera file, or in the scene file"
            )
        if self.camera is not None:
            read_camera_record(self.camera)

    def _fields(self) -> dict[str, Any]:
        """Of the cylinder; None where they are not given."""
        names = ("center", "axis", "radius", "height")
        return {name: getattr(self, name) for name in names}

    def _scene(self) -> "SceneFile":
        """What the scene file holds, or the cylinder alone."""
        from impostor_jax.io.scene_file import SceneFile, read_scene
        from impostor_jax.primitives.cylinder import Cylinder

        if self.scene is not None:
            return read_scene(self.scene)
        return SceneFile([Cylinder(**self._fields())])


def _shapes_of(scene: "SceneFile") -> "AbstractPrimitive | Scene":
    """The only shape, or all of them."""
    from impostor_jax.rendering.scene import Scene

    alone = len(scene.shapes) == 1 and not scene.shapes[0].batch_shape
    return scene.shapes[0] if alone else Scene(scene.shapes)


def _count_of(scene: "SceneFile") -> int:
    return sum(math.prod(shape.batch_shape) for shape in scene.shapes)
