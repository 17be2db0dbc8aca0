"""An image of the video, with all that is known of it."""

__all__ = ["View"]

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.camera.base import posed
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.effort import MIN_READINGS
from impostor_jax.find.found import Found
from impostor_jax.fit.filtered import grows_less
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.fit.options import Options
from impostor_jax.fit.pose import in_double
from impostor_jax.fit.request import FitRequest
from impostor_jax.fit.result import Fit
from impostor_jax.fit.seen import seen_by
from impostor_jax.fits.shown import fit_or_failure
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.track.followed import Followed
from impostor_jax.track.measured import Measured
from impostor_jax.track.sight import MARGIN, Sight, sight_of
from impostor_jax.track.state import State

MOST_LOOKS = 3
"""Times that an image is looked at for one cylinder."""


@dataclasses.dataclass(frozen=True)
class View:
    """An image as a tracker takes it.

    Attributes:
        image: Depth in meters; 0 where there is no reading.
        camera: With its pose.
        bare: The same without.
        noise: Of the sensor.
        rotation: From the world to the camera.
        place: Of the camera, in the world, in meters.
        pixel: Distance of neighboring rays at a distance of 1 m, in meters.
    """

    image: Float[np.ndarray, "h w"]
    camera: PinholeCamera
    bare: PinholeCamera
    noise: AbstractDepthNoise
    rotation: Float[np.ndarray, "3 3"]
    place: Float[np.ndarray, "3"]
    pixel: float

    @staticmethod
    def of(
        image: Float[np.ndarray, "h w"],
        camera: PinholeCamera,
        noise: AbstractDepthNoise,
    ) -> "View":
        """The view of an image, from a camera with its pose, if it has one."""
        rotation, translation = in_double(camera.camera_from_world)
        place = -rotation.T @ translation
        bare = posed(camera, None)
        pixel = float(camera.spacing)
        return View(image, camera, bare, noise, rotation, place, pixel)

    def sight(self, state: State, planes: Float[np.ndarray, "m 4"]) -> Sight:
        """What reads where a cylinder is expected.

        Args:
            state: What is expected.
            planes: Of the scene, in the world frame, as of `sight_of`.
        """
        center = self.rotation @ (state.center - self.place)
        axis = self.rotation @ state.axis
        shape = np.concatenate([center, axis, [state.radius, state.height]])
        beyond = planes[:, 3:] - planes[:, :3] @ self.place[:, None]
        own = np.hstack([planes[:, :3] @ self.rotation.T, beyond])
        return sight_of(shape, self.image, self.bare, self.noise, own)

    def fit_near(
        self,
        one: Followed,
        owner: Int[np.ndarray, "h w"],
        planes: Float[np.ndarray, "m 4"],
        options: Options,
    ) -> tuple[Fit | None, Bool[np.ndarray, "h w"]]:
        """Fit a cylinder to what reads near where it is expected.

        Where it is found elsewhere, what reads near there is fitted, too.

        Args:
            one: The cylinder.
            owner: Whose each pixel is.
            planes: As of `sight`.
            options: Of the fit.

        Returns:
            The fit, or None where too few readings are near; and their pixels.
        """
        state, mask, fit = one.state, owner == one.identity, None
        for _ in range(MOST_LOOKS):
            if np.count_nonzero(mask) < MIN_READINGS:
                break
            fit = self.fit(mask, state.cylinder, options)
            found = fit.cylinder
            distance = float(np.linalg.norm(state.center - self.place))
            # Within the margin all of it was looked at.
            if not _moved(state, found) > MARGIN * self.pixel * distance:
                break
            state = dataclasses.replace(state, **_told(found))
            sight = self.sight(state, planes)
            mask, free = np.zeros_like(mask), owner[sight.window]
            is_own = np.isfinite(sight.gap) & ((free == 0) | (free == one.identity))
            mask[sight.window] = is_own
        return fit, mask

    def fit(
        self, mask: Bool[np.ndarray, "h w"], start: Cylinder, options: Options
    ) -> Fit:
        """A fit to some pixels, from a start."""
        given = self.image, self.camera, mask, self.noise
        return fit_or_failure(FitRequest(CYLINDER, *given, start, options))

    def shows_less(self, found: Found) -> bool:
        """Whether noise grows by less towards grazing than a model of it says."""
        return any(
            grows_less(
                fit,
                CYLINDER.body,
                [seen_by(self.image, mask, self.camera, self.noise)],
            )
            for fit, mask in zip(found.fits, found.masks, strict=True)
        )

    def measured(self, fit: Fit, state: State | None) -> Measured:
        """What a fit says, whose axis has the sign of a state's."""
        axis = None if state is None else state.axis
        return Measured.of(fit, self.place, self.pixel, axis)


def _told(found: Cylinder) -> dict[str, Any]:
    """The fields of a state that are a cylinder's."""
    return {
        "center": np.asarray(found.center, float),
        "axis": np.asarray(found.axis, float),
        "radius": float(found.radius),
        "height": float(found.height),
    }


def _moved(state: State, found: Cylinder) -> float:
    """How far from what was expected a wall is found, in meters; NaN of a failure."""
    axis = np.asarray(found.axis, float)
    offset = np.asarray(found.center, float) - state.center
    aside = np.linalg.norm(offset - (offset @ axis) * axis)
    tilt = np.linalg.norm(np.cross(axis, state.axis)) * state.height / 2
    return float(aside + tilt + abs(float(found.radius) - state.radius))
