"""A page on which a person looks at a fit, among the readings that it is of.

It is one file, which needs a browser with WebGL2 and nothing else. The readings are
points in space, colored by their residuals; the shapes are drawn by the shaders that
parity compares with JAX; and both meet in one depth buffer.
"""

__all__ = ["DIALECT", "FitPage", "drawn_message", "fit_page", "view"]

import dataclasses
import html
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.fit.result import each_of
from impostor_jax.glsl.draw_list import calls_of
from impostor_jax.glsl.html import html_page, packed, textures_message
from impostor_jax.glsl.orbit_page import upright
from impostor_jax.glsl.program import attributes, mark_sources, shader_sources
from impostor_jax.io.atomic import write_text
from impostor_jax.page.frame import PageFrame, page_frame
from impostor_jax.page.picture import outline_path, picture_url
from impostor_jax.page.readings import readings_of
from impostor_jax.page.shown import ImageView, Shown, asked_image, image_view, shown_of
from impostor_jax.page.told import notes_of, numbers_of
from impostor_jax.page.wires import DEVIATIONS, wires_of
from impostor_jax.primitives.base import AbstractPrimitive

DIALECT = "300 es"
"""Of WebGL2."""

MOVES = {
    **dict.fromkeys(("center", "p1", "p2", "translation"), "point"),
    **dict.fromkeys(("axis", "start", "end"), "direction"),
    "rotation": "matrix",
}
"""How those fields of impostors move with the eye that do."""

UNSHOWN = {"points": "points", "outline": "an outline"}
"""Sources of fits that have no depth image, in words."""

FRAME_HEIGHT = 640
"""Of the page in a notebook, in pixels."""


@dataclasses.dataclass(frozen=True)
class FitPage:
    """A page, which a notebook shows below the cell that made it.

    Attributes:
        html: The whole of it, as `save` writes it.
    """

    html: str = dataclasses.field(repr=False)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the page to a file, which a browser opens."""
        write_text(Path(path), self.html)

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{html.escape(self.html)}" title="The fit" '
            f'style="width: 100%; height: {FRAME_HEIGHT}px; border: 0"></iframe>'
        )


def view(result: Any, depth: Any = None, camera: Any = None) -> FitPage:
    """A page to look at what was fitted or found, in a notebook or a browser.

        page = ij.view(ij.fit_cylinder(depth, camera))
        page.save("fit.html")

    It shows the readings in space, by their residuals, the shapes and wireframes of the
    95 % intervals of their sizes, and beside it their numbers and the depth image with
    the outlines. A fit that failed says so, and has no shape.

    Args:
        result: A fit of any shape, a dict of fits of one image, as `fit_labels` returns
            it, or what `find_cylinders` returned.
        depth: (H, W) as it was fitted, in meters, or a list of several; may be left out
            where the fits remember it, which those of traced calls, of batches and of
            images without an object do not.
        camera: That took it; to be given with `depth`, and not without.

    Raises:
        ValueError: The result is another thing, a batch or a fit to points or to an
            outline, does not remember its image, or the image is not of the same size.
    """
    shown = shown_of(result)
    for one in shown:
        if one.fit.source in UNSHOWN:
            raise ValueError(
                "result must be of depth images, got a fit to "
                f"{UNSHOWN[one.fit.source]}"
            )
    if (depth is None) != (camera is None):
        raise ValueError("depth and camera must be given together, got one of them")
    if depth is None:
        asked = asked_image(shown)
        if asked is None:
            raise ValueError(
                "depth and camera must be given: the result does not hold its image, "
                "as it was traced, stacked or changed, or nothing was found"
            )
        depth, camera = asked
    depths, cameras = each_of(depth), each_of(camera)
    counts = {len(each_of(one.fit.region)) for one in shown} | {len(cameras)}
    if counts | {len(depths)} != {len(depths)}:
        raise ValueError(
            "depth and camera must be those of the fit, one for each of its images, "
            f"got {len(depths)} and {len(cameras)}"
        )
    for one in cameras:
        if not isinstance(one, AbstractCamera):
            raise ValueError(f"camera must be a camera, got {type(one).__name__}")
    views = [
        image_view(shown, image, one, number)
        for number, (image, one) in enumerate(zip(depths, cameras, strict=True))
    ]
    return fit_page(shown, views)


def fit_page(shown: Sequence[Shown], views: Sequence[ImageView]) -> FitPage:
    """The page of fits and the images that they are of.

    Args:
        shown: The fits.
        views: At least one; the page begins near the camera of the first.
    """
    frame = page_frame(shown, views)
    message = {
        "shapes": [_shape_message(one, frame) for one in shown],
        "views": [_view_message(one, shown, frame) for one in views],
        "limit": _limit(shown),
        "deviations": DEVIATIONS,
        "up": upright(views[0].camera),
        "radius": frame.radius,
        "readings": mark_sources("reading", DIALECT),
        "wires": mark_sources("wire", DIALECT),
    }
    return FitPage(html_page("page/fit_page.html", message))


def _limit(shown: Sequence[Shown]) -> float:
    """Residual of the last color in meters: of inliers 99 % are less."""
    inliers = [
        np.abs(np.asarray(residual))[np.asarray(inliers)]
        for one in shown
        if one.fit.is_shape
        for residual, inliers in zip(
            each_of(one.fit.residual), each_of(one.fit.inliers), strict=True
        )
    ]
    sizes = np.concatenate([*inliers, np.zeros(0)])
    return max(float(np.percentile(sizes, 99)), 1e-6) if sizes.size else 1e-3


def _view_message(
    view: ImageView, shown: Sequence[Shown], frame: PageFrame
) -> dict[str, Any]:
    """What the script is told of an image."""
    readings = readings_of(view)
    height, width = view.depth.shape
    return {
        "size": [width, height],
        "picture": picture_url(view),
        "outlines": [
            outline_path(one.fit.shape, view.camera) if one.fit.is_shape else ""
            for one in shown
        ],
        "places": packed(frame.from_camera(readings.place, view.camera)),
        "residuals": packed(readings.residual),
        "owners": packed(readings.owner),
        "footprint": readings.footprint,
        "taken_from": frame.from_camera(np.zeros(3), view.camera).tolist(),
    }


def _shape_message(shown: Shown, frame: PageFrame) -> dict[str, Any]:
    """What the script is told of a fit; without what draws it where it failed."""
    fit = shown.fit
    message = {
        "name": shown.name,
        "kind": fit.kind,
        "status": str(fit.status),
        "isGood": bool(fit.success),
        "numbers": numbers_of(shown),
        "notes": notes_of(shown),
        "drawn": None,
        "wires": None,
    }
    if not fit.is_shape:
        return message
    message["drawn"] = drawn_message(fit.shape, frame)
    wires = wires_of(fit)
    if wires is not None:
        message["wires"] = {
            "places": packed(frame.apply(wires.place)),
            "changes": packed(frame.turned(wires.change)),
            "most": wires.most,
        }
    return message


def drawn_message(shape: AbstractPrimitive, frame: PageFrame) -> dict[str, Any]:
    """What draws a shape: its shaders and its instance, in the frame of the page."""
    (call,) = calls_of([frame.batch(shape)])
    impostor = call.impostor
    return {
        "sources": shader_sources(impostor, DIALECT, False, ending="lit.frag"),
        "attributes": attributes(impostor),
        "fields": [
            [count, MOVES.get(name, "number")]
            for name, count in impostor.fields.items()
        ],
        "instance": call.rows[0].tolist(),
        "textures": textures_message(call.textures),
    }
