"""How far the outline of a fitted wall is from where the surface ends in the image.

Depth that is skewed fits a cylinder of the wrong radius, and no residual tells. The
outline does: readings of the surface lie beyond it, where their rays miss the wall, or
readings of the background within it, which the wall would hide. Both are bounds: a hole
or a ragged edge between the last reading of the surface and the first of the background
is no gap.

Nor does a mask that is said to be the outline tell an end, where the wall goes on in
the depth beyond it.
"""

__all__ = ["compared_with_outline", "doubted_edges", "tested_beyond_ends"]

import statistics
import warnings
from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Bool, Float

from impostor_jax.arguments import users_level
from impostor_jax.fit.limb import limb_of
from impostor_jax.fit.result import LARGE_GAP, Fit, OutlineGap
from impostor_jax.fit.seam import WITHIN, wall_readings
from impostor_jax.fit.seen import Seen
from impostor_jax.fit.surface import cropped
from impostor_jax.geometry.so3 import tangent_basis
from impostor_jax.primitives.cylinder import Cylinder

MOST_DEVIATIONS = 5.0
"""Deviations above which a gap is significant: by chance once in 2e6 outlines."""

HALF, LEAST_DEVIATIONS = 0.4, 2.5
"""Radii above which a gap is significant from these deviations on: of a radius that is
off by as much its own deviation tells too little. Of 143 cans with coarse steps of
disparity that neighbors share five had such a gap, and radii 21 to 48 % off."""

NOTED = 2.0
"""Deviations of fit and edge alone above which a caller is warned of a gap that the
sensor's way with edges may explain."""

SURELY_OFF, LEAST_OFF = 3.0, 0.4
"""Deviations of the fit's outline, and pixels, above which an edge in the image is off
by a gap. Of cans with exact edges it is 0, and 0.8 to 2.7 where these reach a pixel or
two too far, as of stereo."""

EDGE = 1.0
"""Standard deviation in pixels of where a surface ends in an image. On the same real
images, with a sensor of which nothing is told, it is off by 0 to 2.7 pixels."""

NUM_PLACES = 16
"""Places along each side of the wall, between its ends."""

ALONG = np.linspace(-0.45, 0.45, NUM_PLACES)
"""Where they are, in lengths of the wall: beside an end the cap may be seen."""

MIN_PLACES = 4
"""Fewest places of a side that show the outline."""

BEYOND = 0.5
"""Radii beside an end within which readings tell whether the wall goes on there."""

ON_WALL = 3.0
"""Deviations up to which they lie on it."""

MOST_BEYOND = 0.5
"""Readings on the wall that goes on, over those as far on this side of the end, at
most; of the table that a can stands on some are as near."""

ALMOST_ALL = 0.8
"""Part of the readings within `WITHIN` radii of it that lie on a wall that goes on."""

MOST_DEVIATION = WITHIN / (2 * ON_WALL)
"""Noise, in radii, with which readings tell these from others."""

FEWEST = 20
"""Readings that say so, at least."""


def compared_with_outline(fit: Fit, seen: Sequence[Seen], is_outline: bool) -> Fit:
    """The fit with its outline gap; a failed one where that contradicts the depth.

    Args:
        fit: Concrete and single.
        seen: The object in each of its images.
        is_outline: Whether the edge of the regions is the silhouette.
    """
    body = fit.shape
    if not (isinstance(body, Cylinder) and fit.is_shape):
        return fit
    found = [gap for one in seen for gap in _gaps(fit, body, one, is_outline)]
    if not found:
        return fit
    gap = max(found, key=lambda one: abs(one.deviations))
    fit = fit.noting(outline_gap=gap)
    if abs(gap.radii) <= LARGE_GAP or not bool(fit.success):
        return fit
    radius = 1e3 * float(body.radius)
    told = (
        f"the image shows the wall's outline {abs(gap.pixels):.1f} pixels "
        f"{'beyond' if gap.pixels > 0 else 'within'} the fit's, which is "
        f"{abs(gap.radii) * radius:.1f} mm at a radius of {radius:.1f} mm"
    )
    least = LEAST_DEVIATIONS if abs(gap.radii) > HALF else MOST_DEVIATIONS
    if abs(gap.deviations) > least:
        return fit.contradicted(
            f"{told} and {abs(gap.deviations):.0f} deviations: the depth is skewed, or "
            "the region is not of one cylinder."
        )
    if abs(gap.pixels) > NOTED * np.hypot(EDGE, gap.fit_pixels):
        told = (
            f"{told}: unless edges in the image are off by as much, the radius is "
            "wrong; fit.outline_gap tells more"
        )
        warnings.warn(told, stacklevel=users_level())
        fit = fit.noting(doubt=told)
    return fit


def doubted_edges(fit: Fit, seen: Sequence[Seen]) -> float:
    """Pixels by which edges beside the wall are off, and so ends may be; 0 if none is.

    An end is told by an edge in the image, which a sensor that matches windows moves,
    and so does a program that fills holes: heights were off by 5 to 60 deviations.

    Args:
        fit: With its outline gap.
        seen: The object in each of its images.
    """
    gap = fit.asked.outline_gap
    if gap is None or not np.any(fit.ends_seen):
        return 0.0
    biases = [one.noise.bias for one in seen]
    if any(bias.errs_at_edges or bias.lean is not None for bias in biases):
        # A sensor that says how edges err.
        return 0.0
    off = abs(gap.pixels)
    return off if off > max(LEAST_OFF, SURELY_OFF * gap.fit_pixels) else 0.0


def tested_beyond_ends(fit: Fit, seen: Sequence[Seen]) -> Fit:
    """The fit, or a failed one where its wall goes on beyond an end of an outline.

    Args:
        fit: Concrete and single.
        seen: The object in each of its images, whose regions are its silhouette.
    """
    body, ends_seen = fit.shape, np.asarray(fit.ends_seen)
    if not (isinstance(body, Cylinder) and fit.is_shape and ends_seen.any()):
        return fit
    half, radius = float(body.height) / 2, float(body.radius)
    reach = BEYOND * radius / half
    told = [_beside_wall(body, one, 1 + reach) for one in seen]
    place, on_wall = map(np.concatenate, zip(*told, strict=True))
    for end, is_seen in zip((-1, 1), ends_seen, strict=True):
        if not is_seen:
            continue
        is_beyond = end * place > 1
        beside = ~is_beyond & (end * place > 1 - reach)
        within = np.count_nonzero(on_wall & beside)
        beyond = np.count_nonzero(on_wall & is_beyond)
        near = np.count_nonzero(is_beyond)
        goes_on = beyond > max(MOST_BEYOND * within, ALMOST_ALL * near)
        if goes_on and beyond >= FEWEST:
            return fit.contradicted(
                "the depth shows the wall beyond an end that the mask's edge tells: "
                "the mask is not the outline, or a wall like it goes on there."
            )
    return fit


def _beside_wall(
    body: Cylinder, seen: Seen, reach: float
) -> tuple[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Places along a wall of readings near it, and whether they lie on it.

    Pixels beside the region count, too, within `reach` half heights from the middle.
    """
    row, col = np.nonzero(seen.region)
    margin = 1 + min(np.ptp(row), np.ptp(col)) // 2
    around = np.zeros_like(seen.region)
    around[cropped(seen.region, margin=int(margin))] = True
    place, _, miss, deviation = wall_readings(body, seen, around, reach)
    tells = deviation < MOST_DEVIATION
    return place[tells], np.abs(miss[tells]) < ON_WALL * deviation[tells]


def _gaps(fit: Fit, body: Cylinder, seen: Seen, is_outline: bool) -> list[OutlineGap]:
    """Gaps of those sides of the wall whose outline an image shows."""
    limb = limb_of(body, seen, ALONG, 3 * float(fit.rms), is_outline)
    if limb is None:
        return []
    sides = np.flatnonzero(np.count_nonzero(limb.shown, axis=1) >= MIN_PLACES)
    if not len(sides):
        return []
    # A sensor moves edges by up to so many pixels: uniformly.
    edge = float(np.hypot(EDGE, float(seen.noise.bias.outline) / np.sqrt(3)))
    covariance, gaps, found = _covariance(fit, body), limb.gap, []
    radius = float(body.radius)
    for k in sides:
        # Of a few numbers NumPy's median takes 0.05 ms.
        radii = statistics.median(gaps[k, limb.shown[k]].tolist())
        # The plane that touches the wall moves as the center does across it, and as
        # the radius.
        moves = np.array([*limb.normal[k], 1.0])
        variance = max(float(moves @ covariance @ moves), 0.0)
        pixels = float(limb.pixels[k])
        of_fit = float(np.sqrt(variance) / radius * pixels)
        gap = radii * pixels
        deviations = gap / float(np.hypot(of_fit, edge))
        found.append(OutlineGap(gap, radii, deviations, of_fit, edge))
    return found


def _covariance(fit: Fit, body: Cylinder) -> Float[np.ndarray, "4 4"]:
    """Of the center's motions across the axis, in the world frame, and the radius."""
    names = ("center_first", "center_second", "radius")
    places = [fit.coordinates.index(name) for name in names]
    covariance = np.asarray(fit.covariance, np.float64)[np.ix_(places, places)]
    # What a gap may be due to, as skewed depth, is no doubt of where the fit's is.
    whole, of_form = float(fit.std.radius), float(fit.std_budget["form"].radius)
    covariance *= 1 - (of_form / whole) ** 2 if 0 < of_form < whole else 1
    into = np.zeros((3, 4))
    into[:2, :3], into[2, 3] = _basis(body.axis), 1.0
    return into.T @ covariance @ into


_basis = jax.jit(tangent_basis)
