"""The caps of a candidate: discs whose rims are seen."""

__all__ = ["NO_CAPS", "UNEVEN", "Caps", "Inner", "caps_of", "doming", "inner_of"]

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from impostor_jax.find.evidence import (
    AGREEING,
    LIMIT,
    UNSURE,
    Evidence,
    Scene,
    ring,
    turned,
)
from impostor_jax.fit.seam import solved
from impostor_jax.geometry.so3 import directions_across

RIM_BINS = 36
"""Bins of the angle around a cap."""

LEAST_RIM = np.pi / 3
"""Angle over which a rim must be seen, in radians: a disc on a table has none."""

GRAZING = 0.2
"""Cosine of the incidence below which a cap is a sliver, and its rim is not asked for:
a fit that lacks its few rows puts the end too early."""

LEAST_FACING = 0.005
"""Cosine of the incidence below which a cap is not seen."""

SLACK, LEAST_SINE = 3.0, 0.05
"""Pixels to which the end of a wall is known, and the sine of the angle between view
and axis above which these are as far along it as that says."""

FEWEST = 20
"""Readings of a cap that tell better than its wall where it is."""

LEAST_FILLED = 0.2
"""Part of a disc that must be seen."""

INNER = 0.85
"""Part of a cap's radius within which readings are of no other surface."""

FEWEST_FLAT = 12
"""Of those, at least."""

UNEVEN = 0.02
"""Root mean square of what a lid may depart from a plane by, or all from its cylinder,
over the radius: those of two real lids, with rims and rings, do by .03, the lining of a
tunnel by .01. Noise that planes tell may be less than that."""


@dataclasses.dataclass(frozen=True)
class Caps:
    """What is seen of the caps.

    Attributes:
        pixels: Flat indices of these.
        rim: Largest angle over which the rim of one is seen, in radians; 0 where it is
            too little to tell a disc from what lies beside it.
        misfit: Mean square of the deviations of what lies on it.
    """

    pixels: Int[np.ndarray, " n"]
    rim: float
    misfit: float = 0.0

    @property
    def size(self) -> int:
        """Pixels that speak for a cylinder."""
        return len(self.pixels) if self.rim else 0

    def misfit_with(self, evidence: Evidence) -> float:
        """Mean square of the deviations of what a wall and this explain."""
        wall, own = evidence.explained, self.size
        return (wall * evidence.misfit + own * self.misfit) / max(wall + own, 1)


NO_CAPS = Caps(np.zeros(0, int), 0.0)


def caps_of(scene: Scene, evidence: Evidence) -> Caps:
    """The caps at the ends of a wall that is seen from outside."""
    if evidence.wall.side < 0:
        return NO_CAPS
    low, high = evidence.ends
    found = [_cap(scene, evidence, low, -1.0), _cap(scene, evidence, high, 1.0)]
    return max(found, key=lambda cap: (cap.rim, len(cap.pixels)))


class Inner(NamedTuple):
    """Readings of a cap that are not near its rim; lengths are over the radius.

    Attributes:
        pixels: Flat indices of them.
        along: Place along the axis, from their median.
        across: Place across it.
        deviation: Of that along the axis.
        middle: Median along the axis, in meters from the wall's center.
    """

    pixels: Int[np.ndarray, " k"]
    along: Float[np.ndarray, " k"]
    across: Float[np.ndarray, "k 2"]
    deviation: Float[np.ndarray, " k"]
    middle: float


def inner_of(scene: Scene, evidence: Evidence, caps: Caps) -> Inner:
    """The readings of a cap that are of no other surface."""
    view, (center, axis, radius, _, _) = scene.view, evidence.wall
    off = view.points.reshape(-1, 3)[caps.pixels] - center
    along = off @ axis
    across = (off - along[:, None] * axis) @ directions_across(axis).T / radius
    inner = (across**2).sum(axis=1) < INNER**2
    index, along = caps.pixels[inner], along[inner]
    cosine = view.views.reshape(-1, 3)[index] @ axis
    sigma = scene.noise * view.sigma.ravel()[index]
    deviation = view.deviation(view.depth.ravel()[index], sigma, cosine)
    deviation = deviation * np.abs(cosine) / radius
    middle = float(np.median(along)) if len(along) else 0.0
    return Inner(index, (along - middle) / radius, across[inner], deviation, middle)


def doming(evidence: Evidence, inner: Inner, shared: float) -> float:
    """How far the middle of a cap stands out, over the radius; 0 where none is seen.

    It is what a paraboloid rises by, less two standard deviations: a disc has none, the
    round end of a bottle or a towel is half a ball.

    Args:
        evidence: Of the wall.
        inner: Readings of its cap.
        shared: How many of them share an error.
    """
    if len(inner.pixels) < FEWEST_FLAT:
        return 0.0
    low, high = evidence.ends
    sign = 1.0 if abs(inner.middle - high) < abs(inner.middle - low) else -1.0
    square = (inner.across**2).sum(axis=1)
    terms = np.column_stack([np.ones_like(square), inner.across, square])
    found = solved(terms, sign * inner.along, inner.deviation)
    noise = np.sqrt(shared) * found.deviation[3]
    return float(max(-found.value[3] - 2 * noise, 0.0))


def _cap(scene: Scene, evidence: Evidence, end: float, sign: float) -> Caps:
    """The cap at one end, whose outward normal is the axis times a sign."""
    view, (center, axis, radius, _, _) = scene.view, evidence.wall
    middle = center + end * axis
    toward = np.array([0.0, 0.0, -1.0])
    if view.is_central:
        toward = -middle / np.linalg.norm(middle)
    facing = sign * float(axis @ toward)
    if facing < LEAST_FACING or middle[2] <= 0:
        return NO_CAPS
    box = view.box_around(ring(evidence.wall, (end, end), 1.5))
    if box is None:
        return NO_CAPS
    width = view.width(float(middle[2]))
    off = view.points[box] - middle.astype(np.float32)
    along = off @ axis.astype(np.float32)
    distance = np.sqrt(np.maximum((off**2).sum(axis=-1) - along**2, 0))
    sigma = scene.noise * view.sigma[box]
    deviation = facing * view.deviation(middle[2], sigma, facing)
    limit = LIMIT * deviation + width
    agrees = sign * (scene.normals.normal[box] @ axis.astype(np.float32)) > AGREEING
    agrees |= scene.normals.error[box] > UNSURE
    # The end of a wall that is seen at a slant is known to some pixels along it, and
    # the readings of the cap tell it better.
    slack = SLACK * width / max(float(np.sqrt(1 - facing**2)), LEAST_SINE)
    near = scene.usable[box] & agrees & (distance < 0.9 * radius)
    near &= np.abs(along) < limit + slack
    if np.count_nonzero(near) >= FEWEST:
        shift = float(np.median(along[near]))
        along, middle = along - shift, middle + shift * axis
    usable, own = scene.usable[box], (scene.free | scene.planes)[box]
    if facing < GRAZING:
        # A row of them is far from both neighbors, as flying pixels are.
        strays = view.valid[box] & ~usable
        usable, own = usable | strays, own | strays
    flat = usable & agrees & (np.abs(along) < limit)
    on_disc = flat & own & (distance < radius)
    count = np.count_nonzero(on_disc)
    if count < max(LEAST_FILLED * np.pi * radius**2 * facing / width**2, 3):
        return NO_CAPS
    met = _on_plane(scene, box, middle, axis) - middle
    away = np.sqrt((met**2).sum(axis=-1)) / radius
    turn = turned(met, axis, RIM_BINS)
    step = max(0.05, width / radius / np.sqrt(facing))

    def counted(mask: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, " b"]:
        return np.bincount(turn[mask], minlength=RIM_BINS)

    inner = usable & (away > 0.5) & (away < 1 - step)
    outer = (away > 1 + step) & (away < 1.35 + step)
    there = counted(inner)
    seen = (counted(inner & flat) >= 0.6 * there) & (there > 0)
    seen &= counted(outer & flat) <= 0.3 * counted(outer & usable)
    rim = 2 * np.pi / RIM_BINS * np.count_nonzero(seen)
    sliver = facing < GRAZING and count > np.count_nonzero(away < 1) / 2
    if rim < LEAST_RIM:
        if not sliver:
            return NO_CAPS
        rim = 0.0
    row, col = np.nonzero(on_disc)
    index = (box[0].start + row) * view.depth.shape[1] + box[1].start + col
    variance = deviation[on_disc] ** 2 + (UNEVEN * radius) ** 2
    misfit = np.mean(along[on_disc] ** 2 / variance)
    return Caps(index, float(rim), float(misfit))


def _on_plane(
    scene: Scene,
    box: tuple[slice, slice],
    middle: Float[np.ndarray, "3"],
    axis: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "h w 3"]:
    """Where rays meet the plane of a cap, whatever they read."""
    view = scene.view
    x, y = view.x[box], view.y[box]
    if view.is_central:
        depth = (middle @ axis) / (x * axis[0] + y * axis[1] + axis[2])
    else:
        rest = (x - middle[0]) * axis[0] + (y - middle[1]) * axis[1]
        depth = middle[2] - rest / axis[2]
    return view.lifted(x, y, depth)
