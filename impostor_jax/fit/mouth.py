"""Mouths: what is seen through the end of a cup or a pipe that is fitted as if closed.

A cylinder ends in a cap. Where most readings through an end lie behind it, it is open,
and what is seen there is the inside: a wall and a floor, which beside the rim lie
behind the cap by less than any robust loss knows. They drew ends in by 14 standard
deviations, and moved a radius by six. They are left out; of a rim that is left the end
is read, and one without is not seen.
"""

__all__ = ["mouth_pixels"]

import jax
import numpy as np
from jaxtyping import Array, Bool

from impostor_jax.fit.gather import passed_by
from impostor_jax.fit.per_pixel import law_of
from impostor_jax.fit.problem import RayList
from impostor_jax.fit.regions import SQUARE
from impostor_jax.fit.round_body import RoundBody
from impostor_jax.fit.seen import Seen
from impostor_jax.opencv import cv2
from impostor_jax.primitives.base import in_camera_frame
from impostor_jax.sensor.base import AbstractDepthNoise

BEHIND = 4.0
"""Standard deviations behind a cap from which a reading is of what lies within."""

FEWEST = 20
"""Readings of that kind that show a mouth."""

MOST_CLOSED = 0.1
"""Share of the readings through an end, from which on they show that it is open. Those
just within a rim lie less far behind: of rolls of paper, through whose bores a third of
the end is seen, they tilted axes by three standard deviations."""

BESIDE = 2
"""Pixels beside such readings that may be of the same."""


def mouth_pixels(seen: Seen, body: RoundBody) -> Bool[np.ndarray, "h w"]:
    """Pixels of a region that see through an open end; none where it is closed.

    Args:
        seen: The region, and what is read there.
        body: An estimate, in the world frame.
    """
    row, col, rays = seen.rays()
    found = _through_ends(rays, in_camera_frame(body, seen.camera), law_of(seen.noise))
    through, behind = map(np.asarray, found)
    count = np.count_nonzero(behind)
    if count < max(FEWEST, MOST_CLOSED * np.count_nonzero(through)):
        return np.zeros(seen.image.shape, bool)

    def marked(which: Bool[np.ndarray, " n"]) -> np.ndarray:
        marks = np.zeros(seen.image.shape, np.uint8)
        marks[row[which], col[which]] = 1
        return marks

    grown = cv2.dilate(marked(behind), SQUARE, iterations=BESIDE)
    return (grown & marked(through)).astype(bool)


@jax.jit
def _through_ends(
    rays: RayList, body: RoundBody, noise: AbstractDepthNoise
) -> tuple[Bool[Array, " n"], Bool[Array, " n"]]:
    """Which readings are seen through an end, and which of these lie behind it."""
    pixels, seen, read, sigma = passed_by(rays, body, noise)
    through = read & seen.on_cap & (seen.rim < seen.cap_radius)
    behind = pixels.depth - (seen.cap + seen.foot) > BEHIND * sigma
    return through, through & behind
