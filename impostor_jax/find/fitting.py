"""Fits of candidates: the search is in the camera's frame, and may see less pixels."""

__all__ = ["Fitter"]

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.find.evidence import Candidate, Evidence
from impostor_jax.find.view import View
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.fit.options import Options
from impostor_jax.fit.regions import typical_sigma
from impostor_jax.fit.result import Fit
from impostor_jax.fit.shapes import fit_shape
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.sensor.base import AbstractDepthNoise

MOST_GUESSES = 6
"""First guesses of an object that are weighed."""

FEW = 2000
"""Pixels of a mask up to which a fit that fails is tried from its own guesses: the
walls that are proposed for a thin thing are rough."""


@dataclasses.dataclass(frozen=True)
class Fitter:
    """Fits what a search proposes.

    Attributes:
        depth: The image, in meters; 0 where there is no reading.
        camera: That took it.
        noise: Of its readings.
        options: Of the fits.
    """

    depth: Float[np.ndarray, "h w"]
    camera: PinholeCamera
    noise: AbstractDepthNoise
    options: Options

    @property
    def mixes(self) -> bool:
        """Whether readings beside an edge may be of another surface."""
        reach = self.noise.edge_reach
        return not isinstance(reach, int) or reach > 0

    def guesses(
        self, view: View, region: Bool[np.ndarray, "h w"]
    ) -> list[Candidate]:
        """First guesses of a region of the view, in the camera's frame."""
        whole = self._of_image(region, view.stride)
        sigma = typical_sigma(self.depth, whole, self.noise)
        bodies = CYLINDER.guesses(self.depth, whole, self.camera, sigma)
        found = []
        for body in bodies[:MOST_GUESSES]:
            center, axis = np.asarray(body.center, float), np.asarray(body.axis, float)
            radius = float(body.radius)
            aside = np.linalg.norm(center - (center @ axis) * axis)
            found.append(Candidate(center, axis, radius, 1.0 if aside > radius else -1.0))
        return found

    def fit(self, mask: Bool[np.ndarray, "h w"], evidence: Evidence) -> Fit:
        """Fit the pixels of a mask of the view, from a wall between its ends."""
        wall, (low, high) = evidence.wall, evidence.ends
        center, axis = wall.center + (low + high) / 2 * wall.axis, wall.axis
        move = self.camera.camera_from_world
        if move is not None:
            back = move.inverse()
            center, axis = np.asarray(back.apply(center)), np.asarray(back.rotate(axis))
        start = Cylinder(center, axis, wall.radius, 1.02 * (high - low))
        stride = -(-self.depth.shape[0] // mask.shape[0])
        whole = self._of_image(mask, stride)
        fit = self._fit(whole, start)
        if bool(fit.success) or np.count_nonzero(whole) > FEW:
            return fit
        return self._fit(whole, None)

    def _fit(self, mask: Bool[np.ndarray, "h w"], start: Cylinder | None) -> Fit:
        return fit_shape(
            CYLINDER, self.depth, self.camera, mask, self.noise, start, self.options
        )

    def wall_of(self, fit: Fit, start: Candidate) -> Candidate:
        """The wall of a fit, in the camera's frame, between the limits of its start."""
        shape, move = fit.cylinder, self.camera.camera_from_world
        center, axis = shape.center, shape.axis
        if move is not None:
            center, axis = move.apply(center), move.rotate(axis)
        center, axis = np.asarray(center, float), np.asarray(axis, float)
        sign = 1.0 if axis @ start.axis > 0 else -1.0
        place = sign * float((start.center - center) @ axis)
        low, high = (place + limit for limit in start.limits)
        radius = float(shape.radius)
        return Candidate(center, sign * axis, radius, start.side, (low, high))

    def _of_image(
        self, mask: Bool[np.ndarray, "h w"], stride: int
    ) -> Bool[np.ndarray, "H W"]:
        """A mask of the view, of all pixels of the image."""
        if stride == 1:
            return mask
        whole = mask.repeat(stride, axis=0).repeat(stride, axis=1)
        return whole[: self.depth.shape[0], : self.depth.shape[1]]
