"""What a search for cylinders returns."""

__all__ = ["FOUND_VERSION", "AbstractFound", "Found", "FoundInPoints"]

import abc
import dataclasses
from collections.abc import Iterator
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from typing_extensions import override

from impostor_jax.arguments import is_exact
from impostor_jax.fit.record import estimate_record, numbers
from impostor_jax.fit.result import Fit
from impostor_jax.fit.status import FitStatus
from impostor_jax.fit.text import millimeters
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.plane import Plane

MOST_ON_LINES = 0.6
"""Part of the points of a cloud that lie along lines of a scan, from which on that is
said: of a stem on rings half a radius apart .56 do, and it is found, and on rings that
are farther apart .7 and more."""

FOUND_VERSION = 1
"""Of the records of searches that are written, as `FIT_VERSION` is of fits."""


def stacked(*parts: Any) -> Any:
    """Arrays one above the other, those that lie far off as precisely as they are."""
    return (np if any(map(is_exact, parts)) else jnp).stack(parts)


class AbstractFound(abc.ABC):
    """What searches of images and of clouds have in common."""

    fits: tuple[Fit, ...]
    visible: Float[np.ndarray, " n"]
    confidence: Float[np.ndarray, " n"]
    inside: Bool[np.ndarray, " n"]
    planes: Plane
    _counted: ClassVar[str]
    """Name of the number of what a fit was made to, in a record."""

    def __len__(self) -> int:
        return len(self.fits)

    def __getitem__(self, number: int) -> Fit:
        """The fit of a cylinder."""
        return self.fits[number]

    def __iter__(self) -> Iterator[Fit]:
        return iter(self.fits)

    @property
    def statuses(self) -> tuple[FitStatus, ...]:
        """How each fit ended."""
        return tuple(fit.status for fit in self.fits)

    @property
    def reasons(self) -> tuple[str, ...]:
        """What is behind each status, in words."""
        return tuple(fit.reason for fit in self.fits)

    def to_dict(self) -> dict[str, Any]:
        """What JSON can hold, as in `found.json`: cylinders and planes."""
        cylinders = [
            {
                "label": k + 1,
                "confidence": numbers(self.confidence[k]),
                "visible": numbers(self.visible[k]),
                "inside": bool(self.inside[k]),
                "status": str(fit.status),
                "world_from_cylinder": numbers(fit.pose),
                **estimate_record(fit),
                "ends_seen": [bool(seen) for seen in fit.ends_seen],
                self._counted: int(fit.num_pixels),
                "rms_m": numbers(fit.rms),
                "chi2": numbers(fit.chi2),
            }
            for k, fit in enumerate(self.fits)
        ]
        planes = zip(self.planes.point, self.planes.unit_normal, strict=True)
        return {
            "version": FOUND_VERSION,
            "cylinders": cylinders,
            "planes": [
                {"point_m": numbers(point), "normal": numbers(normal)}
                for point, normal in planes
            ],
        }

    @property
    def cylinders(self) -> Cylinder:
        """The estimates, a batch (n,) in the world frame."""
        if not self.fits:
            nothing = np.zeros((0,), jnp.result_type(float))
            vectors = np.zeros((0, 3), nothing.dtype)
            return Cylinder(vectors, vectors, nothing, nothing)
        return jax.tree.map(stacked, *(fit.cylinder for fit in self.fits))

    def __str__(self) -> str:
        lines = [
            f"{len(self)} found, {self.planes.batch_shape[0]} planes taken away"
            + self._how_searched()
        ]
        for k, fit in enumerate(self.fits):
            shape, std = fit.cylinder, fit.std
            at = ", ".join(f"{float(x):.4f}" for x in shape.center)
            lines.append(
                f"  {k + 1}: radius {millimeters(shape.radius)} +- "
                f"{millimeters(std.radius)} mm at ({at}) m, {self.visible[k]:.0%} "
                f"visible, confidence {self.confidence[k]:.2f}"
                + (", seen from inside" if self.inside[k] else "")
            )
        return "\n".join(lines)

    def _how_searched(self) -> str:
        """What is to be said of the search."""
        return ""


@dataclasses.dataclass(frozen=True)
class Found(AbstractFound):
    """The n cylinders that were found in a depth image, the surest first.

    Attributes:
        fits: One fit each: estimate, standard deviations, covariance, status, and which
            ends are seen. All of them succeeded.
        masks: Pixels that show each, wall and caps together; of none do two.
        visible: Part of each one's silhouette, beyond the frame too, that is seen.
        confidence: Probability that each is there: within 5 degrees, 0.15 radii and 10
            percent of the radius.
        inside: Whether each is seen from inside, as a pipe is looked into.
        planes: The m planes that were taken away before the search, in the world frame.
            Each faces the camera. Far from the origin their points are NumPy arrays
            in double precision, as the places of the fits are.
    """

    fits: tuple[Fit, ...]
    masks: Bool[np.ndarray, "n h w"]
    visible: Float[np.ndarray, " n"]
    confidence: Float[np.ndarray, " n"]
    inside: Bool[np.ndarray, " n"]
    planes: Plane
    _counted: ClassVar[str] = "num_pixels"

    @property
    def labels(self) -> Int[np.ndarray, "h w"]:
        """Number of the cylinder that each pixel shows, from 1; 0 where none does."""
        labels = np.zeros(self.masks.shape[1:], np.int32)
        for number, mask in enumerate(self.masks, start=1):
            labels[mask] = number
        return labels


@dataclasses.dataclass(frozen=True)
class FoundInPoints(AbstractFound):
    """The n cylinders that were found in a cloud of points, the surest first.

    Attributes:
        fits: As of `Found`; `region` and `residual` of the k-th are of the points whose
            label is k.
        labels: Number of the cylinder that each point is of, from 1; 0 where it is of
            none.
        visible: Part of each one's wall, between its ends, that has points.
        confidence: As of `Found`, like the others.
        inside: Whether each is seen from inside, where the viewpoint is known.
        planes: The m planes that were taken away. They face the viewpoint, where it is
            known.
        num_searched: Points that were searched: of a larger cloud one of each voxel.
        on_lines: Part of them whose neighbors are all of one line of a scan, so that no
            wall shows at them; 0 where the viewpoint is not known.
    """

    fits: tuple[Fit, ...]
    labels: Int[np.ndarray, " p"]
    visible: Float[np.ndarray, " n"]
    confidence: Float[np.ndarray, " n"]
    inside: Bool[np.ndarray, " n"]
    planes: Plane
    num_searched: int
    on_lines: float = 0.0
    _counted: ClassVar[str] = "num_points"

    @property
    def masks(self) -> Bool[np.ndarray, "n p"]:
        """Which points are of each."""
        return self.labels == np.arange(1, len(self) + 1)[:, None]

    @override
    def _how_searched(self) -> str:
        told = ""
        if self.num_searched < len(self.labels):
            told = f"; thinned to {self.num_searched} of {len(self.labels)} points"
        if self.on_lines > MOST_ON_LINES:
            told += (
                f"; {self.on_lines:.0%} of the points lie along lines of a scan that "
                "are too far apart to show a wall"
            )
        return told
