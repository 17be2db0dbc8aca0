"""How even the outline of a wall is from end to end.

Where neighboring readings share their errors, no residual tells a cup of a few degrees,
a bottle's shoulder or rounded ends from a cylinder. The outline does: it is known to a
pixel or two at each place, whatever the depth is off by.
"""

__all__ = ["unevenness"]

import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.fit.limb import Limb, limb_of
from impostor_jax.fit.seen import Seen
from impostor_jax.primitives.base import in_camera_frame
from impostor_jax.primitives.cylinder import Cylinder

ALONG = np.linspace(-0.49, 0.49, 41)
"""Places along a wall, in lengths of it."""

MIDDLE = 0.25
"""Places so far from the middle at most are what both ends are compared with."""

END = 0.36
"""Distance from the middle at which an end begins, in lengths of the wall."""

CLEAR = 4.0
"""Pixels from an end within which nothing is compared: sensors round corners."""

FEWEST = 3
"""Places of an end, and between the ends, that show the outline of a side, at least."""

EDGE = 0.5
"""Standard deviation of the outline at an end of a side, in pixels."""

SENSOR = 0.02
"""The same in radii: of sensors whose edges are off by more along some than along
others."""

ALLOWED = 0.04
"""Change that is not held against a wall, in radii: a real camera, whose depth was
warped to its color image, narrows a lying can by as much."""


def unevenness(body: Cylinder, seen: Seen, rms: float, turn: float) -> float:
    """How much the outline of a wall widens, narrows or bulges from end to end.

    It is the change of the radius, over the radius, beyond two standard deviations and
    what is `ALLOWED`; 0 where the image does not show it.

    Args:
        body: The wall, in the world frame.
        seen: It, in an image whose planes are far behind.
        rms: Of what its readings are off by, in meters.
        turn: Standard deviation of its axis, in radians.
    """
    limb = limb_of(body, seen, ALONG, 3 * rms)
    if limb is None:
        return 0.0
    half = float(body.height) / 2 / float(body.radius) * _foreshortened(body, seen)
    low, high = (_change(limb, half, sign) for sign in (-1, 1))
    known = ~np.isnan(high) & ~np.isnan(low)
    if not known.any():
        return 0.0
    noise = np.hypot(EDGE / limb.pixels[known], SENSOR) / np.sqrt(np.sum(known))
    # A turn of the axis moves the two sides of an end by the opposite.
    turned = 0.0 if known.all() else 2 * half * turn
    widening = abs(float(np.mean(high[known] - low[known])))
    bulge = abs(float(np.mean(high[known] + low[known])))
    deviation = float(np.sqrt(2 * np.mean(noise**2)))
    most = max(widening - 2 * float(np.hypot(deviation, turned)), bulge - 2 * deviation)
    return max(most - ALLOWED, 0.0)


def _change(limb: Limb, half: float, sign: int) -> Float[np.ndarray, "2"]:
    """Of each side's outline from the middle to an end, in radii; NaN where unknown.

    Surface and background must agree on it: either may end early, at a hole or in the
    shadow of a sensor's lamp. What they agree on is the smaller change of the two.

    Args:
        limb: What the image shows.
        half: Of the wall's length in the image, in radii.
        sign: Of the end.
    """
    from_end = (0.5 - np.abs(ALONG)) * 2 * half * limb.pixels[:, None]
    is_end = limb.shown & (from_end >= CLEAR) & (sign * ALONG >= END)
    is_middle = limb.shown & (np.abs(ALONG) <= MIDDLE)
    surface, background = (
        _medians(places, is_end) - _medians(places, is_middle)
        for places in (limb.surface, limb.background)
    )
    smaller = np.where(np.abs(surface) < np.abs(background), surface, background)
    return np.where(surface * background < 0, 0.0, smaller)


def _medians(
    places: Float[np.ndarray, "2 s"], own: Bool[np.ndarray, "2 s"]
) -> Float[np.ndarray, "2"]:
    """Of some places of each side; NaN of too few."""
    return np.array(
        [
            np.median(side[some]) if np.count_nonzero(some) >= FEWEST else np.nan
            for side, some in zip(places, own, strict=True)
        ]
    )


def _foreshortened(body: Cylinder, seen: Seen) -> float:
    """Part of the wall's length that a camera sees."""
    body = in_camera_frame(body, seen.camera)
    center, axis = (np.asarray(x, np.float64) for x in (body.center, body.axis))
    along = float(center @ axis) / float(np.linalg.norm(center))
    return float(np.sqrt(max(1 - along**2, 0.0)))
