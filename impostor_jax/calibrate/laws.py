"""The noise of single readings, and the grain that neighbors share, from differences.

Half the mean square of the difference of two readings d pixels apart on a plane is

    sigma(depth, incidence)^2 / depth^(2 power) + s^2 (1 - exp(-d^2 / (2 l^2)))

with the grain's s and l; and the same of the warp, which is known. The law of sigma is
the noise model's own.
"""

__all__ = ["KINDS", "Kind", "Readings", "law_of_all", "readings_of", "sigma_of"]

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.calibrate.differences import LAGS, Differences
from impostor_jax.calibrate.warp import SHORTEST_WARP, Smooth
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.gaussian import ConstantNoise
from impostor_jax.sensor.quantization import StereoDisparity
from impostor_jax.sensor.structured_light import StructuredLight
from impostor_jax.sensor.time_of_flight import TimeOfFlight

SPREAD = 1.0
"""Standard deviation of the logarithm of a law's number, relative to the others, before
anything is measured: images of one depth do not tell how noise grows with it."""

PAIRS = 8.0
"""Differences that tell as much as one that is independent of all others."""

MOST_STEPS = 30
"""Of the fit of a law."""

SIGNIFICANT = 20.0
"""Part of what a law leaves unexplained that grain explains, over that of each degree
of freedom, at least."""

LEAST_GRAIN = 0.01
"""Variance of the grain over that of readings, at least."""

APART = 2.5
"""Distance over the grain's length, beyond which readings share none of it."""

AT_END = 0.98
"""Length over the largest, above which what is found is of another kind, and longer."""

LONGEST_GRAIN = 0.5
"""Its length over the warp's, and over the largest of `LAGS`, at most."""

LONGEST_WARP = 300.0
"""In pixels, that differences tell of."""

BLOCK = 64
"""Classes of readings are filled up to a multiple, so that little is compiled."""


class Kind(NamedTuple):
    """A kind of sensor.

    Attributes:
        power: Of the depth, with which smooth errors grow.
        matches: Whether it compares windows of images.
        fitted: Names of the numbers of its law.
        law: With the usual numbers, of a camera with some focal length in pixels of its
            own and some baseline in meters.
    """

    power: float
    matches: bool
    fitted: tuple[str, ...]
    law: Callable[[float, float], AbstractDepthNoise]


KINDS = {
    "structured_light": Kind(
        2.0, True, ("floor", "growth", "grazing"), lambda *_: StructuredLight()
    ),
    "stereo": Kind(
        2.0, True, ("deviation",), lambda *camera: StereoDisparity(*camera, step=0.0)
    ),
    "time_of_flight": Kind(0.0, False, ("floor", "growth"), lambda *_: TimeOfFlight()),
    "constant": Kind(0.0, False, ("deviation",), lambda *_: ConstantNoise(0.001)),
}
"""By name."""


class Readings(NamedTuple):
    """What readings err by on their own, and with their neighbors.

    Attributes:
        law: The noise model of single readings.
        grain: The error that next neighbors share; None if it is not significant.
        warp: What is left, as far as differences tell.
        ratio: Variance of the grain over that of single readings.
    """

    law: AbstractDepthNoise
    grain: Smooth | None
    warp: Smooth | None
    ratio: float


def readings_of(
    differences: Differences,
    kind: Kind,
    first: AbstractDepthNoise,
    warp: Smooth | None,
    *,
    find_warp: bool = False,
) -> Readings:
    """The law whose differences are the measured ones.

    Args:
        differences: The measured ones.
        kind: Of the law.
        first: A law that it begins with, and is like where nothing is measured.
        warp: That is in the differences, too.
        find_warp: Whether `warp` is only what it begins with.
    """
    model = _Model(differences, kind, first, warp, find_warp)
    own = np.zeros(model.num_own)
    trials = [
        _least_squares(model.residuals, np.concatenate([own, start]))
        for start in model.grains
    ]
    found, together = min(trials, key=lambda trial: trial[1])
    plain, alone = _least_squares(model.residuals, own)
    freedom = max(int(np.count_nonzero(model.weight)) - len(found), 1)
    gain = (alone - together) / (together / freedom + 1e-30)
    grain = model.grain(found)
    if gain < SIGNIFICANT or grain is None or not model.is_apart(found, grain):
        return Readings(model.law(plain), None, model.warp_at(plain), 0.0)
    ratio = model.ratio(found, grain)
    return Readings(model.law(found), grain, model.warp_at(found), ratio)


def law_of_all(
    differences: Differences,
    kind: Kind,
    first: AbstractDepthNoise,
    warp: Smooth | None,
    grain: Smooth,
) -> AbstractDepthNoise:
    """The law by which readings err, their grain counted in.

    Args:
        differences: The measured ones.
        kind: Of the law.
        first: As of `readings_of`.
        warp: That is in the differences, too.
        grain: Of which differences at a distance hold all.
    """
    apart = (np.array(LAGS) > APART * grain.length) | (np.array(LAGS) == LAGS[-1])
    beyond = differences._replace(number=differences.number * apart)
    model = _Model(beyond, kind, first, warp, False)
    return model.law(_least_squares(model.residuals, np.zeros(model.num_own))[0])


def sigma_of(
    law: AbstractDepthNoise,
    depth: Float[np.ndarray, " n"],
    cosine: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """Standard deviations of readings, in double precision."""
    count = len(depth)
    filled = [np.resize(part, -(-count // BLOCK) * BLOCK) for part in (depth, cosine)]
    with jax.enable_x64(True):
        numbers = jax.tree.map(lambda x: jnp.asarray(x, float), law)
        return np.asarray(_sigma(numbers, *map(jnp.asarray, filled)))[:count]


@jax.jit
def _sigma(
    law: AbstractDepthNoise, depth: Float[Array, " n"], cosine: Float[Array, " n"]
) -> Float[Array, " n"]:
    return law.sigma(depth, cosine)


@dataclasses.dataclass(frozen=True)
class _Model:
    """What is compared with the differences.

    What is fitted are logarithms: of the law's numbers over those it begins with; of
    the warp's, if it is fitted; of the grain's deviation, and its length's odds.

    Attributes:
        differences: The measured ones.
        kind: Of the law.
        first: What it begins with.
        warp: That is in the differences, too.
        find_warp: Whether it is fitted.
    """

    differences: Differences
    kind: Kind
    first: AbstractDepthNoise
    warp: Smooth | None
    find_warp: bool

    @functools.cached_property
    def weight(self) -> Float[np.ndarray, "b k"]:
        """Reciprocal of the standard deviation of a half square's logarithm."""
        number = self.differences.number
        is_known = (number > 0) & (self.differences.half_square > 0)
        return np.sqrt(np.where(is_known, number, 0) / (2 * PAIRS))

    @property
    def num_own(self) -> int:
        """How many of what is fitted are not the grain's."""
        return len(self.kind.fitted) + 2 * self.find_warp

    def law(self, at: Float[np.ndarray, " p"]) -> AbstractDepthNoise:
        """The law with some of the numbers."""

        def numbers(law: Any) -> list[Any]:
            return [getattr(law, name) for name in self.kind.fitted]

        usual = numbers(self.first)
        values = [
            float(value * math.exp(log)) for value, log in zip(usual, at, strict=False)
        ]
        return eqx.tree_at(numbers, self.first, values)

    def warp_at(self, at: Float[np.ndarray, " p"]) -> Smooth | None:
        """The warp with some of the numbers."""
        if not self.find_warp or self.warp is None:
            return self.warp
        deviation, length = at[len(self.kind.fitted) : self.num_own]
        # Beyond the shortest.
        usual = self.warp.length - SHORTEST_WARP
        length = min(SHORTEST_WARP + usual * math.exp(length), LONGEST_WARP)
        return Smooth(self.warp.deviation * math.exp(deviation), length)

    def longest(self, at: Float[np.ndarray, " p"]) -> float:
        """Length of a grain, at most, in pixels."""
        warp = self.warp_at(at)
        return LONGEST_GRAIN * min(LAGS[-1], LAGS[-1] if warp is None else warp.length)

    def grain(self, at: Float[np.ndarray, " p"]) -> Smooth | None:
        """The grain with some of the numbers; None where there are none for one."""
        if len(at) == self.num_own:
            return None
        deviation, odds = at[self.num_own :]
        # Of less than a pixel it would be noise, of more it would be the warp.
        share = 1 / (1 + math.exp(-odds))
        return Smooth(math.exp(deviation), 1 + (self.longest(at) - 1) * share)

    @property
    def grains(self) -> Sequence[Float[np.ndarray, "2"]]:
        """Numbers of grains that a fit begins with."""
        typical = math.log(float(np.median(self._white(np.zeros(self.num_own))))) / 2
        return [np.array([typical - 0.7, odds]) for odds in (-2.0, 0.0)]

    def is_apart(self, at: Float[np.ndarray, " p"], grain: Smooth) -> bool:
        """Whether the grain is a part of the noise, and has a length of its own."""
        is_short = grain.length < AT_END * self.longest(at)
        return is_short and self.ratio(at, grain) > LEAST_GRAIN

    def ratio(self, at: Float[np.ndarray, " p"], grain: Smooth) -> float:
        """Variance of a grain over that of single readings."""
        return grain.deviation**2 / float(np.median(self._white(at)))

    def residuals(self, at: Float[np.ndarray, " p"]) -> Float[np.ndarray, " r"]:
        """Standardized deviations of the differences, and of the law from usual."""
        expected = np.repeat(self._white(at)[:, None], len(LAGS), axis=1)
        for smooth in (self.warp_at(at), self.grain(at)):
            if smooth is not None:
                shared = np.exp(-0.5 * (np.array(LAGS) / smooth.length) ** 2)
                expected += smooth.deviation**2 * (1 - shared)
        found = np.where(self.weight > 0, self.differences.half_square, 1)
        away = self.weight * np.log(found / expected)
        own = at[: len(self.kind.fitted)]
        return np.concatenate([away.ravel(), (own - own.mean()) / SPREAD])

    def _white(self, at: Float[np.ndarray, " p"]) -> Float[np.ndarray, " b"]:
        depth, cosine = self.differences.depth, self.differences.cosine
        return (sigma_of(self.law(at), depth, cosine) / depth**self.kind.power) ** 2


def _least_squares(
    residuals: Callable[[Float[np.ndarray, " p"]], Float[np.ndarray, " r"]],
    start: Float[np.ndarray, " p"],
) -> tuple[Float[np.ndarray, " p"], float]:
    """Least squares by Levenberg and Marquardt; where, and the sum of the squares."""
    at, damping, tiny = start, 1e-3, 1e-5
    now = residuals(at)
    for _ in range(MOST_STEPS):
        slopes = [(residuals(at + tiny * e) - now) / tiny for e in np.eye(len(at))]
        jacobian = np.stack(slopes, axis=1)
        square, pull = jacobian.T @ jacobian, jacobian.T @ now
        lift = np.diag(np.diag(square)) + 1e-9 * np.trace(square) * np.eye(len(at))
        step = -np.linalg.solve(square + damping * lift, pull)
        step = np.clip(step, -1, 1)
        after = residuals(at + step)
        if after @ after < now @ now:
            gain = (now @ now - after @ after) / (now @ now)
            at, now, damping = at + step, after, damping / 5
            if gain < 1e-7 and np.abs(step).max() < 1e-3:
                break
        else:
            damping *= 8
            if damping > 1e8:
                break
    return at, float(now @ now)
