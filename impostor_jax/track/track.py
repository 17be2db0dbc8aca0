"""What a tracker tells of a cylinder."""

__all__ = ["Track", "TrackStatus"]

import dataclasses
import enum
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.fit.budget import Deviations
from impostor_jax.fit.record import numbers
from impostor_jax.fit.result import Fit
from impostor_jax.fit.text import millimeters
from impostor_jax.primitives.cylinder import Cylinder

UNITS = {"axis": "rad", "velocity": "m_per_s"}
"""Of standard deviations; of all others it is the meter."""


class TrackStatus(enum.StrEnum):
    """How a track stands after an image."""

    NEW = "new"
    """Found in this image."""
    TRACKED = "tracked"
    """Seen in this image, and before."""
    LOST = "lost"
    """Not seen in this image: where it is follows from before."""


@dataclasses.dataclass(frozen=True)
class Track:
    """A cylinder that is followed through images, as of one of them.

    Attributes:
        identity: Number of the cylinder, from 1; none is given twice.
        status: Whether the image shows it.
        reason: In words, why it is lost; empty where it is not.
        cylinder: The estimate from all images so far, in the world frame. What is lost
            is where it would be now.
        velocity: (3,), of its center in the world, in m/s.
        std: One standard deviation of center, velocity (in m/s), axis, radius and
            height, and of the center across and along the axis, by names as of a fit's
            `std`; `inf` where no image has told. With errors that images share.
        covariance: Of `coordinates`, of all errors.
        coordinates: Their names; axis_first and axis_second are along the two vectors
            of `tangent_basis(axis)`.
        time: Of the image, in seconds.
        first_seen: Time of the first image that shows it.
        last_seen: Of the last one.
        num_fits: Images that the estimate is from.
        visible: Part of its expected pixels in the image that read near its surface.
        mask: Pixels that show it; none where it is lost.
        fit: To this image alone; None where it is lost.
    """

    identity: int
    status: TrackStatus
    reason: str
    cylinder: Cylinder
    velocity: Float[np.ndarray, "3"]
    std: Deviations
    covariance: Float[np.ndarray, "10 10"]
    coordinates: tuple[str, ...]
    time: float
    first_seen: float
    last_seen: float
    num_fits: int
    visible: float
    mask: Bool[np.ndarray, "h w"]
    fit: Fit | None

    def to_dict(self) -> dict[str, Any]:
        """What JSON can hold, without pixels; None for what is not finite."""
        shape = self.cylinder
        std = {
            f"{name}_{UNITS.get(name, 'm')}": numbers(getattr(self.std, name))
            for name in ("center", "axis", "radius", "height", "velocity")
        }
        return {
            "identity": self.identity,
            "status": str(self.status),
            "reason": self.reason,
            "time_s": self.time,
            "first_seen_s": self.first_seen,
            "last_seen_s": self.last_seen,
            "num_fits": self.num_fits,
            "visible": self.visible,
            "center_m": numbers(shape.center),
            "axis": numbers(shape.axis),
            "radius_m": numbers(shape.radius),
            "height_m": numbers(shape.height),
            "velocity_m_per_s": numbers(self.velocity),
            "std": std,
        }

    def __str__(self) -> str:
        at = ", ".join(f"{float(x):.4f}" for x in self.cylinder.center)
        why = f" ({self.reason})" if self.reason else ""
        return (
            f"{self.identity}: {self.status}{why}, radius "
            f"{millimeters(self.cylinder.radius)} +- {millimeters(self.std.radius)} mm "
            f"at ({at}) m, {np.linalg.norm(self.velocity):.2f} m/s, of "
            f"{self.num_fits} images"
        )
