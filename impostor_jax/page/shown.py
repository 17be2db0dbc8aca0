"""What a page shows: fits by their names, and the depth images that they are of."""

__all__ = [
    "ImageView",
    "Shown",
    "asked_image",
    "image_view",
    "shown_of",
]

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from impostor_jax.arguments import is_concrete
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.find.found import Found
from impostor_jax.fit.result import Fit, each_of


@dataclasses.dataclass(frozen=True)
class Shown:
    """A fit on a page.

    Attributes:
        name: Heads it.
        fit: A single, concrete one.
        confidence: Probability that the shape is there, as of `Found`; None where
            nobody searched for it.
        visible: Part of its silhouette that is seen, likewise.
    """

    name: str
    fit: Fit
    confidence: float | None = None
    visible: float | None = None


@dataclasses.dataclass(frozen=True)
class ImageView:
    """A depth image, and which fit explains what of it.

    Attributes:
        depth: In meters; 0 where there is no reading.
        camera: That took it.
        owner: Number of the fit that used a pixel, from 0; -1 where none did.
        residual: Reading less depth of that fit's surface, in meters; `+inf` where the
            fit failed, 0 where there is none.
    """

    depth: Float[np.ndarray, "h w"]
    camera: AbstractCamera
    owner: Int[np.ndarray, "h w"]
    residual: Float[np.ndarray, "h w"]


def shown_of(result: Any) -> list[Shown]:
    """What a page shows of a fit, of fits by their names, or of a search.

    Raises:
        ValueError: It is something else, or holds several fits as one, or traced ones.
    """
    if isinstance(result, Found):
        found = zip(result.fits, result.confidence, result.visible, strict=True)
        return [
            Shown(f"cylinder {number}", fit, float(confidence), float(visible))
            for number, (fit, confidence, visible) in enumerate(found, start=1)
        ]
    if not isinstance(result, Mapping):
        return [Shown(_single(result).kind, result)]
    return [
        Shown(f"label {name}" if isinstance(name, int) else str(name), _single(fit))
        for name, fit in result.items()
    ]


def _single(fit: Any) -> Fit:
    if not isinstance(fit, Fit):
        raise ValueError(
            "result must be a fit, fits by their names, or what find_cylinders "
            f"returned, got {type(fit).__name__}"
        )
    if not is_concrete(fit) or np.ndim(fit.status_code):
        raise ValueError(
            "result must be a single, concrete fit, got a batch or a traced one; take "
            "one of a batch by jax.tree.map(lambda values: values[k], fits)"
        )
    return fit


def image_view(
    shown: Sequence[Shown], depth: Any, camera: AbstractCamera, number: int = 0
) -> ImageView:
    """A depth image as fits explain it.

    Args:
        shown: The fits, all of this image.
        depth: (H, W) as it was fitted, in meters; 0, NaN or infinity mean no reading.
        camera: That took it.
        number: Of the image among those of the fits.

    Raises:
        ValueError: The image is not of the camera's size, or the fits are of another.
    """
    # A copy, that is changed; of JAX's arrays there is no other.
    readings = np.array(depth, float)
    size = camera.height, camera.width
    if readings.shape != size:
        raise ValueError(
            f"depth must have the camera's shape {size}, got {readings.shape}"
        )
    readings[~(np.isfinite(readings) & (readings > 0))] = 0
    owner, residual = np.full(size, -1), np.zeros(size)
    for owned_by, one in enumerate(shown):
        region, off = (
            np.asarray(each_of(x)[number]) for x in (one.fit.region, one.fit.residual)
        )
        if region.shape != size:
            raise ValueError(
                f"depth must be the image that was fitted, of shape {region.shape}, "
                f"got {size}"
            )
        used = region & (readings > 0)
        owner[used] = owned_by
        residual[used] = off[used] if one.fit.is_shape else np.inf
    return ImageView(readings, camera, owner, residual)


def asked_image(shown: Sequence[Shown]) -> tuple[Any, Any] | None:
    """The images that fits remember, and their cameras; None where they do not.

    Of several images there are lists.
    """
    asked = [one.fit.asked.arguments for one in shown]
    if not asked or asked[0] is None:
        return None
    return asked[0]["depth"], asked[0]["camera"]
