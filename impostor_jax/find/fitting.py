"""Fits of what a search proposes.

Fits know cameras with a center. Parallel rays are those of a center that is far away:
with one at 1e5 meters they are off by some micrometers where a scene is a meter deep,
and double precision keeps the rest. What is found in a sector of a scan is fitted in
the scan.
"""

__all__ = ["Fitter"]

import dataclasses
import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, PRNGKeyArray
from typing_extensions import override

from impostor_jax.camera.base import AbstractCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.camera.ray_table import directions_of
from impostor_jax.camera.spherical import SphericalCamera
from impostor_jax.effort import Effort
from impostor_jax.find.evidence import Candidate, Evidence
from impostor_jax.find.sectors import Sector
from impostor_jax.find.view import View
from impostor_jax.fit.fittable import CYLINDER
from impostor_jax.fit.options import Options
from impostor_jax.fit.pose import in_double
from impostor_jax.fit.regions import (
    BUCKETS,
    STEEP,
    DepthUnitsWarning,
    jump_parts,
    typical_sigma,
)
from impostor_jax.fit.request import FitRequest, checked_noise, is_trusted
from impostor_jax.fit.result import Asked, Fit
from impostor_jax.fit.shapes import fit_shape, prepare_fit
from impostor_jax.fit.status import FitStatus
from impostor_jax.fit.surface import cropped
from impostor_jax.fit.threads import in_background
from impostor_jax.geometry.frames import RigidTransform
from impostor_jax.numerics import Numbers
from impostor_jax.opencv import cv2
from impostor_jax.primitives.cylinder import Cylinder
from impostor_jax.sensor.base import AbstractDepthNoise, Depths, Normals
from impostor_jax.sensor.bias import Bias, is_none

MOST_GUESSES = 6
"""First guesses of an object that are weighed."""

QUICK: dict[str, Any] = {"doubts": False, "readings": 4096, "max_steps": 20}
"""What is less of a fit that tries a candidate."""

_PREPARED: set[Any] = set()
"""For which fits programs are prepared in this process."""

AT_END = 2
"""Pixels by which a mask may fall short of an end, and within which what lies far
behind begins there."""

FAR_BEHIND = 4.0
"""Steps between neighbors from which something lies far behind."""

MOSTLY = 0.5
"""Part of the readings beside such an end with something far behind, at least."""

NEAREST = 1e-3
"""Smallest depth that a noise model is asked for, in meters."""

FAR = 1e5
"""Distance of the center of parallel rays behind their plane z = 0, in meters."""


@dataclasses.dataclass(frozen=True)
class Fitter:
    """Fits what a search proposes.

    Attributes:
        depth: As `seen_by` sees it, in meters; 0 where there is no reading.
        camera: That took it.
        noise: Of its readings.
        sigma: What a caller said of that.
        options: Of the fits.
        seen_by: The camera of the fits.
        away: How much farther from that the readings are, in meters.
        searched_from_world: Frame of what is searched; None where that is the world.
        sector: Which part of a scan is searched; None for the whole image.
        is_measured: Whether nobody told the noise that fits are told.
    """

    depth: Float[np.ndarray, "h w"]
    camera: AbstractCamera
    noise: AbstractDepthNoise
    sigma: Any
    options: Options
    seen_by: PinholeCamera | SphericalCamera
    away: float
    searched_from_world: RigidTransform | None
    sector: Sector | None = None
    is_measured: bool = False

    @staticmethod
    def of(
        depth: Float[np.ndarray, "h w"],
        camera: AbstractCamera,
        noise: AbstractDepthNoise,
        sigma: Any,
        options: Options,
    ) -> "Fitter":
        """A fitter of an image; the arguments are those of a search, checked."""
        move = camera.camera_from_world
        if isinstance(camera, PinholeCamera):
            return Fitter(depth, camera, noise, sigma, options, camera, 0.0, move)
        if noise.bias.scales or noise.bias.fields:
            raise ValueError(
                "sigma must be a sensor without errors of scale and smooth errors "
                "where rays do not meet in one point, got "
                f"{type(noise).__name__} and {type(camera).__name__}"
            )
        effort = dataclasses.replace(options.effort, precision="float64")
        far = _far(camera)
        shifted = None if sigma is None else _Shifted(noise, FAR)
        options = dataclasses.replace(options, effort=effort)
        farther = np.where(depth > 0, depth.astype(np.float64) + FAR, 0)
        return Fitter(farther, camera, noise, shifted, options, far, FAR, move)

    @staticmethod
    def of_sector(
        sector: Sector,
        ranges: Float[np.ndarray, "h w"],
        camera: SphericalCamera,
        noise: AbstractDepthNoise,
        sigma: Any,
        options: Options,
    ) -> "Fitter":
        """A fitter of what is found in a sector of a scan."""
        move = sector.sector_from_camera
        if camera.camera_from_world is not None:
            move = move @ camera.camera_from_world
        return Fitter(ranges, camera, noise, sigma, options, camera, 0.0, move, sector)

    @property
    def is_trusted(self) -> bool:
        """Whether what fits are told of the noise is all that readings err by."""
        return is_trusted(self.sigma)

    @property
    def by_itself(self) -> "Fitter":
        """One that lets the pixels of each mask tell their noise."""
        return dataclasses.replace(self, sigma=None, is_measured=False)

    @property
    def mixes(self) -> bool:
        """Whether readings beside an edge may be of another surface."""
        return not is_none(self.noise.bias.edge_reach)

    def of_image(
        self, view: View, mask: Bool[np.ndarray, "h w"]
    ) -> Bool[np.ndarray, "H W"]:
        """A mask of what is searched, as one of the image."""
        if self.sector is None:
            return view.enlarged(mask, self.depth.shape)
        shape = self.depth.shape[0], len(self.sector.cols)
        return self.sector.of_scan(view.enlarged(mask, shape))

    def agrees(self, view: View) -> Bool[np.ndarray, "H W"] | np.bool_:
        """Pixels of the image that show what their pixel of what is searched does."""
        return view.agrees(self.depth) if self.sector is None else np.True_

    def guesses(self, region: Bool[np.ndarray, "h w"]) -> list[Candidate]:
        """First guesses of a region of the image, in the camera's frame."""
        if self.away or isinstance(self.seen_by, SphericalCamera):
            # They are made in single precision, and of planar depth.
            return []
        sigma = typical_sigma(self.depth, region, self.noise)
        bodies = CYLINDER.guesses(self.depth, region, self.seen_by, sigma)
        found = []
        for body in bodies[:MOST_GUESSES]:
            center, axis = np.asarray(body.center, float), np.asarray(body.axis, float)
            radius = float(body.radius)
            aside = np.linalg.norm(center - (center @ axis) * axis)
            side = 1.0 if aside > radius else -1.0
            found.append(Candidate(center, axis, radius, side))
        return found

    def prepare(self) -> None:
        """Load or compile what fits take, in a thread, once for all such images.

        While an image is searched, which takes about as long the first time.
        """
        if self.away:
            return
        noise = jax.tree.structure(checked_noise(self.sigma, self.seen_by))
        key = noise, type(self.seen_by), self.options.effort, jnp.result_type(float)
        if key in _PREPARED:
            return
        _PREPARED.add(key)
        valid = np.flatnonzero(self.depth > 0)

        def compile_all() -> None:
            region = np.zeros(self.depth.shape, bool)
            region.ravel()[valid[: BUCKETS[0]]] = True
            given = self.depth, self.seen_by, region, self.sigma
            prepare_fit(FitRequest(CYLINDER, *given, None, self.options))

        in_background(compile_all)

    def tried(self, mask: Bool[np.ndarray, "h w"], evidence: Evidence) -> Fit:
        """A quick fit, as `fit`: most of what is fitted is refused."""
        return self._started(mask, evidence, self._quick)

    def guessed(self, mask: Bool[np.ndarray, "h w"]) -> Fit:
        """The same of pixels of the image, from their own guesses."""
        return self._fit(mask, None, self._quick)

    def fit(self, mask: Bool[np.ndarray, "h w"], evidence: Evidence) -> Fit:
        """Fit the pixels of a mask of the image, from a wall between its ends."""
        return self._started(mask, evidence, self.options.effort)

    def up_to_ends(
        self, mask: Bool[np.ndarray, "H W"], fit: Fit
    ) -> Bool[np.ndarray, "H W"] | None:
        """A mask with what it lacks of a wall at an end that its fit does not see.

        What is searched is coarser than the image, and normals beside an end are of
        what lies behind it, too. None where nothing far behind begins there.
        """
        is_open, camera = ~np.asarray(fit.ends_seen), self.seen_by
        if not is_open.any() or self.away or isinstance(camera, SphericalCamera):
            return None
        box = cropped(mask, margin=2 * AT_END)
        z, own = self.depth[box], mask[box]
        noisy, width = jump_parts(z, camera, self.noise, np)
        step = noisy + STEEP * width
        around = np.ones((2 * AT_END + 1,) * 2, np.uint8)
        farthest = cv2.dilate(np.where(own, z, 0), around)
        nearest = -cv2.dilate(np.where(own, -z, -np.inf).astype(z.dtype), around)
        near = ~own & (z > 0) & (z > nearest - step) & (z < farthest + step)
        row, col = np.nonzero(near)
        rows, cols = row + box[0].start, col + box[1].start
        x, y = directions_of(camera, rows, cols, np.float64)
        rotation, translation = in_double(camera.camera_from_world)
        seen = np.stack([x, y, np.ones_like(x)], axis=1) * z[near][:, None]
        shape = fit.cylinder
        points = (seen - translation) @ rotation - np.asarray(shape.center, float)
        place = points @ np.asarray(shape.axis, float)
        beyond = np.abs(place) > float(shape.height) / 2 - 2 * AT_END * width[near]
        is_last = (cv2.dilate(z, around) > z + FAR_BEHIND * step)[near]
        kept = np.zeros_like(beyond)
        for end in np.flatnonzero(is_open):
            there = beyond & ((place > 0) == end)
            # Where it is not, the surface goes on, as a bottle's shoulder does.
            if there.any() and np.mean(is_last[there]) > MOSTLY:
                kept |= there & is_last
        if not kept.any():
            return None
        whole = mask.copy()
        whole[rows[kept], cols[kept]] = True
        return whole

    @property
    def _quick(self) -> Effort:
        return dataclasses.replace(self.options.effort, **QUICK)

    def _started(
        self, mask: Bool[np.ndarray, "h w"], evidence: Evidence, effort: Effort
    ) -> Fit:
        wall, (low, high) = evidence.wall, _around(evidence)
        center = wall.center + (low + high) / 2 * wall.axis
        rotation, translation = in_double(self.searched_from_world)
        if not self.away:
            center = center - translation
        start = Cylinder(
            center @ rotation,
            wall.axis @ rotation,
            wall.radius,
            1.02 * (high - low),
        )
        fit = self._fit(mask, start, effort)
        if bool(fit.success) or self.away or not evidence.is_narrow:
            return fit
        if fit.status == FitStatus.UNDETERMINED:
            # It is the readings that leave something open.
            return fit
        return self._fit(mask, None, effort)

    def _fit(
        self, mask: Bool[np.ndarray, "h w"], start: Cylinder | None, effort: Effort
    ) -> Fit:
        given = self.depth, self.seen_by, mask, self.sigma
        options = dataclasses.replace(self.options, effort=effort)
        with warnings.catch_warnings():
            # Of what is refused nobody wants to know; what is found tells it itself.
            warnings.filterwarnings("ignore", "the image shows the wall's outline")
            if self.away:
                # The depth is not what the caller gave.
                warnings.simplefilter("ignore", DepthUnitsWarning)
            request = FitRequest(CYLINDER, *given, start, options)
            fit = fit_shape(request, in_search=True)
        if not self.away:
            return fit
        fit = _in_own_precision(fit)
        if not bool(fit.success):
            return fit
        # The far camera has the rotation of its pose alone.
        shape = fit.cylinder
        rotation, translation = in_double(self.searched_from_world)
        center = np.asarray(shape.center) - translation @ rotation
        moved = Cylinder(center, shape.axis, shape.radius, shape.height)
        # What was asked was asked of the far camera.
        return dataclasses.replace(fit, shape=moved, asked=Asked())

    def wall_of(self, fit: Fit, start: Candidate) -> Candidate:
        """The wall of a fit, in the searched frame, between the limits of its start."""
        shape, move = fit.cylinder, self.searched_from_world
        center, axis = shape.center, shape.axis
        if move is not None:
            center, axis = move.apply(center), move.rotate(axis)
        center, axis = np.asarray(center, float), np.asarray(axis, float)
        sign = 1.0 if axis @ start.axis > 0 else -1.0
        place = sign * float((start.center - center) @ axis)
        low, high = (place + limit for limit in start.limits)
        radius = float(shape.radius)
        return Candidate(center, sign * axis, radius, start.side, (low, high))


def _around(evidence: Evidence) -> tuple[float, float]:
    """Ends of a wall; of one that the camera is inside of, behind the camera."""
    wall, (low, high) = evidence.wall, evidence.ends
    place = -float(wall.center @ wall.axis)
    aside = np.linalg.norm(wall.center + place * wall.axis)
    if wall.side > 0 or aside >= wall.radius:
        return low, high
    if place < (low + high) / 2:
        return min(low, place - wall.radius), high
    return low, max(high, place + wall.radius)


def _far(camera: Any) -> PinholeCamera:
    """A camera with a center far behind that of an orthographic one."""
    move = camera.camera_from_world
    rotation = np.eye(3) if move is None else move.rotation
    return PinholeCamera(
        float(camera.fx) * FAR,
        float(camera.fy) * FAR,
        camera.cx,
        camera.cy,
        camera.width,
        camera.height,
        camera_from_world=RigidTransform(rotation, np.array([0, 0, FAR])),
    )


class _Shifted(AbstractDepthNoise):
    """A noise model whose camera stands farther away.

    Args:
        noise: The model.
        away: How much farther, in meters.
    """

    noise: AbstractDepthNoise
    away: float

    @override
    def sigma(self, depth: Numbers, cos_incidence: Numbers) -> Numbers:
        # What stands in for the depth of a miss is not far away.
        near = jnp.maximum(depth - self.away, NEAREST)
        return self.noise.sigma(jnp.where(depth > 0, near, depth), cos_incidence)

    @property
    @override
    def bias(self) -> Bias:
        return self.noise.bias

    @override
    def sample(
        self, key: PRNGKeyArray, depth: Depths, normal: Normals, camera: AbstractCamera
    ) -> Depths:
        readings = self.noise.sample(key, depth - self.away, normal, camera)
        return readings + self.away


def _in_own_precision(fit: Fit) -> Fit:
    """A fit in double precision with numbers that JAX computes with outside of it."""
    own = jnp.result_type(float)

    def told(value: Any) -> Any:
        # JAX warns of what it would cut down itself.
        is_double = isinstance(value, jax.Array) and value.dtype == np.float64
        return jnp.asarray(np.asarray(value).astype(own)) if is_double else value

    return jax.tree.map(told, fit)
