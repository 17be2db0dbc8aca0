"""What a search for cylinders returns."""

__all__ = ["FOUND_VERSION", "Found"]

import dataclasses
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.arguments import is_exact
from impostor_jax.fit.record import estimate_record, numbers
from impostor_jax.fit.result import Fit
from impostor_jax.fit.status import FitStatus
from impostor_jax.fit.text import millimeters
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.primitives.plane import Plane

FOUND_VERSION = 1
"""Of the records of searches that are written, as `FIT_VERSION` is of fits."""


def stacked(*parts: Any) -> Any:
    """Arrays one above the other, those that lie far off as precisely as they are."""
    return (np if any(map(is_exact, parts)) else jnp).stack(parts)


@dataclasses.dataclass(frozen=True)
class Found:
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
                "num_pixels": int(fit.num_pixels),
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
        lines = [f"{len(self)} found, {self.planes.batch_shape[0]} planes taken away"]
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
