"""Stems before a laser scanner: cylinders, or with bark, in the window that shows them.

The scanner is the origin and level, as in the camera frame: y points down. The ground
is `SCANNER_HEIGHT` below it, and of a stem the part is seen that undergrowth leaves
free, with nothing behind. So a few rows and columns of the scan are all there is.
"""

__all__ = ["BREAST_HEIGHT", "SCANNER_HEIGHT", "Scan", "draw_scan"]

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import impostor_jax as ij
from data_synth.roughness import Roughness, roughened
from experiments.scenes import View
from impostor_jax.matching import points_of

SCANNER_HEIGHT = 1.7
"""Of the scanner above the ground, in meters."""

BREAST_HEIGHT = 1.3
"""Above the ground, in meters, where foresters measure a diameter."""

SEEN_HEIGHTS = (0.5, 2.7)
"""Above the ground, in meters, between which a stem is seen."""

STEP = np.radians(0.05)
"""Between neighboring rows and columns."""

HALF_WIDTH = 0.45
"""Of the window at the stem, in meters: the widest stem, and its tilt."""

DIAMETERS = (0.1, 0.5)
"""Least and largest, in meters."""

STEM_HEIGHT = 14.0
"""In meters: its ends are out of sight."""

MOST_TILTED = np.radians(4.0)
"""Of the axis, towards the scanner and across."""


@dataclasses.dataclass(frozen=True)
class Scan:
    """What a scanner reads of one stem.

    Attributes:
        view: The stem, and in place of depths the ranges; 0 beside it.
        camera: The scanner's rows and columns that show the stem.
        points: The readings, in the camera frame, in meters.
    """

    view: View
    camera: ij.SphericalCamera
    points: Float[np.ndarray, "n 3"]

    @property
    def diameter(self) -> float:
        """The true one, in meters."""
        assert isinstance(self.view.shape, ij.Cylinder)
        return 2 * float(self.view.shape.radius)


def draw_scan(
    distance: float, sigma: float, bark: Roughness | None, rng: np.random.Generator
) -> Scan:
    """A stem at a distance, to 10 cm, of any diameter, and a scan of it.

    Args:
        distance: Of the stem from the scanner, in meters.
        sigma: Standard deviation of a range, in meters.
        bark: How rough the stem is; None for a cylinder.
        rng: Source of all that is drawn.
    """
    camera = _window(distance)
    x, z = rng.uniform(-0.02, 0.02), distance + rng.uniform(-0.1, 0.1)
    across, towards = np.tan(rng.uniform(-MOST_TILTED, MOST_TILTED, 2))
    breast = SCANNER_HEIGHT - BREAST_HEIGHT
    stem = ij.Cylinder(
        (x, breast, z), (across, 1, towards), rng.uniform(*DIAMETERS) / 2, STEM_HEIGHT
    )
    maps = ij.render(stem, camera, outputs=("depth", "mask", "normal"))
    true, mask = maps.depth, np.asarray(maps.mask)
    if bark is not None:
        key = jax.random.key(int(rng.integers(2**31)))
        settings = jnp.asarray(bark.deviation), jnp.asarray(bark.length)
        true = _with_bark(key, true, maps.normal, camera, *settings)
    read = np.where(mask, np.asarray(true), 0) + mask * rng.normal(0, sigma, mask.shape)
    read = read.astype(np.float32)
    points = points_of(read, camera)[mask].astype(float)
    return Scan(View(stem, read, mask, sigma), camera, points)


_with_bark = jax.jit(roughened)


def _window(distance: float) -> ij.SphericalCamera:
    """The rows and columns that show a stem at a distance."""
    low, high = (np.arctan2(h - SCANNER_HEIGHT, distance) for h in SEEN_HEIGHTS)
    half = np.arctan2(HALF_WIDTH, distance)
    return ij.SphericalCamera(np.arange(high, low, -STEP), np.arange(-half, half, STEP))
