"""Scenery without flat faces or straight walls, of many balls.

They are no heightfields: one of those is cast at every ray of an image, which takes
seconds, and balls at the rays that can meet them.
"""

__all__ = ["Arms", "Bags", "Bottles", "Bumps", "Hands", "Rolls"]

import dataclasses
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from data_synth.distribution import Distribution
from data_synth.scenery_base import Loose, Shapes, Things, somewhere
from data_synth.solid import Cluster
from impostor_jax.primitives.sphere import Sphere

LINKS = 32
"""Balls of a finger, or of a bump: 2 mm apart, so that one of 8 mm is uneven by less
than 0.1 mm."""

PROFILE = 96
"""Balls of a body of revolution: 2 mm apart in one of 20 cm."""

LUMPS = 40
"""Balls of a bag, which overlap by far."""

FINGERS, METACARPALS = 5, 4
"""The balls of a hand are in so many rows."""


@dataclasses.dataclass(frozen=True)
class _OfBalls(Things):
    """Things that are made of balls, and touch nothing else."""

    may_touch: ClassVar[bool] = False


@dataclasses.dataclass(frozen=True)
class Hands(_OfBalls):
    """Hands that lie on the table, palm down: rows of balls, tapered and bent.

    Attributes:
        length: From the wrist to the longest finger's tip, in meters.
    """

    length: Distribution

    shapes: ClassVar[Shapes] = Sphere, LINKS * (FINGERS + METACARPALS)

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        def vary(value: float) -> float:
            return value * rng.uniform(0.85, 1.15)

        side = rng.choice([-1.0, 1.0])
        fan, curl = rng.uniform(0.0, 0.12), rng.uniform(0.6, 1.0)
        rows = []
        # In millimeters of a hand of 185: the knuckle aside, the length and the radius.
        for aside, long, wide in (
            (30.0, 72.0, 9.0),
            (10.0, 80.0, 9.5),
            (-10.0, 74.0, 9.0),
            (-29.0, 58.0, 7.5),
        ):
            long, wide, aside = vary(long), vary(wide), side * aside
            turn = fan * aside / 10 + rng.uniform(-0.08, 0.08)
            knuckle = np.array([0.0, aside, vary(26.0)])
            reach = curl * long * np.array([np.cos(turn), np.sin(turn), 0.0])
            lift = np.array([0.0, rng.uniform(-4, 4), vary(12.0) + 40 * (1 - curl)])
            tip = knuckle * [1, 1, 0] + reach + [0.0, 0.0, 0.75 * wide]
            between = knuckle + 0.55 * reach + lift
            finger = np.stack([knuckle, between, tip])
            rows.append(_row(finger, (1.15 * wide, 0.72 * wide), 0.06))
            wrist = np.array([-vary(85.0), 0.5 * aside, vary(20.0)])
            middle = (knuckle + wrist) / 2 + [0.0, 0.0, 4.0]
            palm = np.stack([knuckle, middle, wrist])
            rows.append(_row(palm, (1.3 * wide, vary(17.0)), 0.0))
        thumb = np.array(
            [[-60.0, 20.0, 19.0], [-45.0, 62.0, vary(24.0)], [vary(8.0), 66.0, 8.0]]
        )
        rows.append(_row(thumb * [1.0, side, 1.0], (vary(15.0), vary(8.5)), 0.05))
        center, radius = (np.concatenate(parts) for parts in zip(*rows, strict=True))
        center[:, 2] -= np.min(center[:, 2] - radius)
        scale = self.length.draw(rng) / 185.0
        hand = Cluster("hand", scale * center, scale * radius)
        return Loose(somewhere(hand, spread, rng))


@dataclasses.dataclass(frozen=True)
class Bumps(_OfBalls):
    """Prolate ellipsoids, as rows of balls, of which the table shows the upper part.

    Attributes:
        width: Half of the shorter axes, in meters.
        stretch: Half the distance of the foci over that; 0 for a ball.
        part: Of the half width that is above the table, up to 2.
    """

    width: Distribution
    stretch: Distribution
    part: Distribution

    shapes: ClassVar[Shapes] = Sphere, LINKS

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        short = self.width.draw(rng)
        focus = short * self.stretch.draw(rng)
        # The largest balls in an ellipsoid: their centers end before the foci.
        end = focus**2 / np.hypot(focus, short)
        along = np.linspace(-end, end, LINKS)
        radius = short * np.sqrt(1 - np.square(along / max(focus, 1e-9)))
        height = np.full(LINKS, short * (self.part.draw(rng) - 1))
        center = np.stack([along, np.zeros(LINKS), height], axis=1)
        return Loose(somewhere(Cluster("bump", center, radius), spread, rng))


@dataclasses.dataclass(frozen=True)
class Arms(_OfBalls):
    """Forearms that lie on the table: rows of balls, tapered, thicker near the elbow.

    Attributes:
        length: In meters.
        radius: Of the thicker end, in meters.
        taper: Radius of the wrist over that.
        swell: How much thicker the muscle is, as a part.
        bend: How far the middle is off the straight, over the length, at most.
    """

    length: Distribution
    radius: Distribution
    taper: Distribution
    swell: Distribution
    bend: Distribution

    shapes: ClassVar[Shapes] = Sphere, PROFILE

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        length, wide = self.length.draw(rng), self.radius.draw(rng)
        t = np.linspace(0.0, 1.0, PROFILE)
        straight = 1 + (self.taper.draw(rng) - 1) * t
        muscle = self.swell.draw(rng) * np.exp(-(((t - 0.25) / 0.2) ** 2))
        radius = wide * (straight + muscle)
        off = length * self.bend.draw(rng) * 4 * t * (1 - t)
        center = np.stack([length * (t - 0.5), off, radius], axis=1)
        return Loose(somewhere(Cluster("arm", center, radius), spread, rng))


@dataclasses.dataclass(frozen=True)
class Bottles(_OfBalls):
    """Bottles, jars and jugs without a straight wall: a waist, a belly and a shoulder.

    Attributes:
        radius: Of the foot, in meters.
        aspect: Height over that.
        waist: How much narrower, or, if negative, wider, the middle is, as a part.
        neck: Radius of the neck over that of the foot.
        shoulder: Part of the height over which it narrows to the neck.
        lying: Share of those that lie.
    """

    radius: Distribution
    aspect: Distribution
    waist: Distribution
    neck: Distribution
    shoulder: Distribution
    lying: float

    shapes: ClassVar[Shapes] = Sphere, PROFILE
    signed: ClassVar[tuple[str, ...]] = ("waist",)

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        foot = self.radius.draw(rng)
        height, neck = foot * self.aspect.draw(rng), self.neck.draw(rng)
        t = np.linspace(0.0, 1.0, PROFILE)
        body = 1 - self.waist.draw(rng) * np.sin(np.pi * t) ** 2
        past = t - 0.95 + self.shoulder.draw(rng)
        radius = foot * (neck + (body - neck) / (1 + np.exp(20 * past)))
        # Round at the foot, so that no ball reaches below it.
        place = np.maximum(height * t, radius)
        center = np.stack([0 * t, 0 * t, place], axis=1)
        if rng.random() < self.lying:
            center = np.stack([place - height / 2, 0 * t, 0 * t + radius.max()], axis=1)
        return Loose(somewhere(Cluster("bottle", center, radius), spread, rng))


@dataclasses.dataclass(frozen=True)
class Bags(_OfBalls):
    """Bags of coffee or of cloth: lumps in an ellipsoid, on the table.

    Attributes:
        size: Half of its axes, in meters; each is drawn.
        lump: Radius of a lump over the smallest of those.
    """

    size: Distribution
    lump: Distribution

    shapes: ClassVar[Shapes] = Sphere, LUMPS

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        size = np.array([self.size.draw(rng) for _ in range(3)])
        radius = size.min() * np.array([self.lump.draw(rng) for _ in range(LUMPS)])
        inside = rng.normal(size=(LUMPS, 3))
        inside /= np.linalg.norm(inside, axis=1, keepdims=True)
        inside *= rng.random((LUMPS, 1)) ** (1 / 3)
        center = inside * np.maximum(size - radius.max(), 0.1 * size)
        center[:, 2] -= np.min(center[:, 2] - radius)
        return Loose(somewhere(Cluster("bag", center, radius), spread, rng))


@dataclasses.dataclass(frozen=True)
class Rolls(_OfBalls):
    """Rolled towels and cushions: rows of balls whose size and height wander.

    Attributes:
        length: In meters.
        radius: In meters.
        unevenness: Standard deviation of the radius, as a part.
        wave: Length over which it wanders, over the radius.
    """

    length: Distribution
    radius: Distribution
    unevenness: Distribution
    wave: Distribution

    shapes: ClassVar[Shapes] = Sphere, PROFILE

    @override
    def draw(self, spread: float, rng: np.random.Generator) -> Loose:
        length, middle = self.length.draw(rng), self.radius.draw(rng)
        place = np.linspace(-length / 2, length / 2, PROFILE)
        wave = middle * self.wave.draw(rng)
        away = (place[:, None] - place) / wave
        smooth = np.exp(-(away**2))
        smooth /= np.sqrt((smooth**2).sum(axis=1, keepdims=True))
        uneven, aside = (smooth @ rng.normal(size=(PROFILE, 2))).T
        part = self.unevenness.draw(rng)
        radius = middle * np.clip(1 + part * uneven, 0.4, 1.8)
        off = part * middle * aside
        center = np.stack([place, off, radius], axis=1)
        return Loose(somewhere(Cluster("roll", center, radius), spread, rng))


def _row(
    points: Float[np.ndarray, "3 3"], radii: tuple[float, float], swell: float
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Balls along a bent line, from one radius to another, thicker at three joints.

    Args:
        points: Three control points of a Bézier curve.
        radii: Of the first ball and of the last.
        swell: How much thicker, as a part.
    """
    t = np.linspace(0.0, 1.0, LINKS)
    weights = np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], axis=1)
    radius = (radii[0] + t * (radii[1] - radii[0])) * (
        1 + swell * np.cos(4 * np.pi * t)
    )
    return weights @ points, radius
