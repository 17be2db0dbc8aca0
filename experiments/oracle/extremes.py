"""Random rays at random cylinders, over all the extremes together."""

__all__ = ["Draws", "Rays", "across", "extreme_rays", "unit"]

import dataclasses

import numpy as np
from jaxtyping import Float


@dataclasses.dataclass(frozen=True)
class Rays:
    """One ray and one cylinder in each row; every number is exact in the dtype."""

    origin: Float[np.ndarray, "n 3"]
    direction: Float[np.ndarray, "n 3"]
    center: Float[np.ndarray, "n 3"]
    axis: Float[np.ndarray, "n 3"]
    radius: Float[np.ndarray, " n"]
    height: Float[np.ndarray, " n"]


class Draws:
    """Random numbers, one for each of `count` rays."""

    def __init__(self, count: int, seed: int):
        self.count = count
        self.rng = np.random.default_rng(seed)

    def log_uniform(self, low: float, high: float) -> Float[np.ndarray, " n"]:
        """Each order of magnitude is as likely as any other."""
        return np.exp(self.rng.uniform(np.log(low), np.log(high), self.count))

    def choose(self, weights: list[float], *options) -> Float[np.ndarray, "n 3"]:
        """Take one of the options, with these probabilities, for each ray."""
        kind = self.rng.choice(len(options), size=self.count, p=weights)
        return np.choose(kind[:, None], options)

    def view_and_axis(self) -> tuple[np.ndarray, np.ndarray]:
        """Forward directions; axes anywhere or nearly along or across what matters."""
        view = unit(self.rng.normal(size=(self.count, 3)) * [0.5, 0.5, 1.0])
        view[:, 2] = np.abs(view[:, 2])
        tilt = self.log_uniform(1e-9, 1e-3)[:, None]
        anywhere = unit(self.rng.normal(size=(self.count, 3)))
        aside = np.cross(view, across(view)) * np.cos(tilt) + across(view) * np.sin(
            tilt
        )
        coordinate = np.eye(3)[self.rng.integers(3, size=self.count)]
        axis = self.choose(
            [0.5, 0.2, 0.15, 0.15],
            anywhere,
            unit(view + tilt * anywhere),
            unit(aside + tilt * anywhere),
            unit(coordinate + tilt * anywhere),
        )
        return view, axis

    def cameras(
        self, target: Float[np.ndarray, "n 3"], view: Float[np.ndarray, "n 3"]
    ) -> tuple[np.ndarray, ...]:
        """Rays towards points, from inside to far away, and what they are scaled by.

        Returns:
            Origins, directions, where what lies at 0 comes to lie, and scales (n, 1).
        """
        clearance = self.log_uniform(1e-6, 1e6)
        inside = self.rng.uniform(0, 1, self.count)[:, None]
        distance = self.choose([0.8, 0.2], (1 + clearance)[:, None], inside)
        origin, center, scale, moved = self.placed(target - view * distance)
        return origin, view / np.where(moved, view[:, 2:], 1), center, scale

    def placed(self, origin: Float[np.ndarray, "n 3"]) -> tuple[np.ndarray, ...]:
        """Cameras in scenes of all sizes.

        Half of them are the origin of their frame, as in an image.

        Returns:
            Origins, where what lies at 0 comes to lie, scales (n, 1), and which are the
            origin of their frame (n, 1).
        """
        scale = self.log_uniform(1e-6, 1e6)[:, None]
        moved = self.rng.uniform(size=self.count)[:, None] < 0.5
        center = np.where(moved, -origin, 0) * scale
        return np.where(moved, 0, origin) * scale, center, scale, moved


def unit(v: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Scale to length 1."""
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def across(v: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """One unit vector across each."""
    other = np.eye(3)[np.argmin(np.abs(v), axis=-1)]
    return unit(np.cross(v, other))


def extreme_rays(count: int, seed: int, dtype: str = "float32") -> Rays:
    """Draw rays; each extreme is met by a good part of them, most by several.

    Scale of the scene 1e-6 to 1e6; distance over radius from inside over 1 + 1e-6 to
    1e6; height over radius 1e-4 to 1e4; the axis anywhere, or within 1e-7 rad of the
    ray, of a plane across it or of a coordinate axis; the ray towards a point on the
    wall, a cap, the rim or a cap's center, within 1e-6 of grazing, or anywhere.

    Args:
        count: Number of rays.
        seed: Of the draws.
        dtype: Numbers are rounded to it; the axis is rounded after it is a unit vector.
    """
    draws = Draws(count, seed)
    rng, log_uniform, choose = draws.rng, draws.log_uniform, draws.choose
    view, axis = draws.view_and_axis()
    radius = np.ones(count)
    height = log_uniform(1e-4, 1e4)
    # Where the ray goes, relative to the center, in the frame of the axis.
    u = across(axis)
    w = np.cross(axis, u)
    angle = rng.uniform(0, 2 * np.pi, count)[:, None]
    out = np.cos(angle) * u + np.sin(angle) * w
    place = rng.uniform(-0.5, 0.5, count)[:, None] * height[:, None] * axis
    end = np.sign(rng.uniform(-1, 1, count))[:, None] * height[:, None] / 2 * axis
    graze = 1 + (log_uniform(1e-9, 1e-3) * np.sign(rng.uniform(-1, 1, count)))[:, None]
    # Beside the axis as the ray sees it: there the wall is grazed.
    edge = np.cross(view, axis)
    edge /= np.maximum(np.linalg.norm(edge, axis=-1, keepdims=True), 1e-300)
    target = choose(
        [0.35, 0.15, 0.1, 0.05, 0.2, 0.15],
        place + out,
        end + out * np.sqrt(rng.uniform(0, 1, count))[:, None],
        end + out,
        end,
        place + edge * graze,
        3 * rng.normal(size=(count, 3)) + place,
    )
    origin, direction, center, scale = draws.cameras(target, view)
    values = (origin, direction, center, axis, radius * scale[:, 0], height)
    origin, direction, center, axis, radius, height = values
    height = height * scale[:, 0]
    rounded = (origin, direction, center, axis, radius, height)
    return Rays(*(value.astype(dtype) for value in rounded))
