"""Distributions of one number, as frozen dataclasses that a manifest can hold."""

__all__ = [
    "Choice",
    "Distribution",
    "Fixed",
    "LogUniform",
    "Uniform",
    "Whole",
    "check_not_negative",
    "check_positive",
]

import abc
import dataclasses
import math

import numpy as np
from typing_extensions import override

Number = float | int


@dataclasses.dataclass(frozen=True)
class Distribution(abc.ABC):
    """A number that is drawn."""

    @abc.abstractmethod
    def draw(self, rng: np.random.Generator) -> Number:
        """Draw one."""

    @property
    def ends(self) -> tuple[Number, Number]:
        """The smallest and the largest that is drawn, which are among its numbers."""
        numbers = np.hstack(dataclasses.astuple(self)).tolist()
        return min(numbers), max(numbers)

    @abc.abstractmethod
    def __str__(self) -> str:
        """What is drawn, for a reader."""


def check_positive(name: str, value: Distribution | Number) -> None:
    """Raise a `ValueError` unless all that is drawn, or a number, is positive."""
    if not _least(value) > 0:
        raise ValueError(f"{name} must be positive, got {value}")


def check_not_negative(name: str, value: Distribution | Number) -> None:
    """Raise a `ValueError` where some that is drawn, or a number, is negative."""
    if _least(value) < 0:
        raise ValueError(f"{name} must not be negative, got {value}")


def _least(value: Distribution | Number) -> Number:
    return value.ends[0] if isinstance(value, Distribution) else value


@dataclasses.dataclass(frozen=True)
class Fixed(Distribution):
    """Always the same."""

    value: Number

    @override
    def draw(self, rng: np.random.Generator) -> Number:
        return self.value

    @override
    def __str__(self) -> str:
        return f"{self.value:g}"


@dataclasses.dataclass(frozen=True)
class Uniform(Distribution):
    """Evenly between two numbers."""

    low: Number
    high: Number

    def __post_init__(self) -> None:
        if not self.low <= self.high:
            raise ValueError(f"low must be at most high, got {self.low}, {self.high}")

    @override
    def draw(self, rng: np.random.Generator) -> Number:
        return float(rng.uniform(self.low, self.high))

    @override
    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g}"


@dataclasses.dataclass(frozen=True)
class LogUniform(Distribution):
    """Evenly in the logarithm between two positive numbers."""

    low: Number
    high: Number

    def __post_init__(self) -> None:
        if not 0 < self.low <= self.high:
            raise ValueError(
                f"low must be positive and at most high, got {self.low}, {self.high}"
            )

    @override
    def draw(self, rng: np.random.Generator) -> Number:
        return math.exp(rng.uniform(math.log(self.low), math.log(self.high)))

    @override
    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g}, even in the logarithm"


@dataclasses.dataclass(frozen=True)
class Whole(Distribution):
    """A whole number, both ends included."""

    low: int
    high: int

    def __post_init__(self) -> None:
        if not self.low <= self.high:
            raise ValueError(f"low must be at most high, got {self.low}, {self.high}")

    @override
    def draw(self, rng: np.random.Generator) -> Number:
        return int(rng.integers(self.low, self.high, endpoint=True))

    @override
    def __str__(self) -> str:
        return f"{self.low} to {self.high}"


@dataclasses.dataclass(frozen=True)
class Choice(Distribution):
    """One of some numbers, all as likely."""

    values: tuple[Number, ...]

    def __post_init__(self) -> None:
        if not self.values:
            raise ValueError("values must hold at least one number, got none")

    @override
    def draw(self, rng: np.random.Generator) -> Number:
        return self.values[int(rng.integers(len(self.values)))]

    @override
    def __str__(self) -> str:
        return "one of " + ", ".join(f"{value:g}" for value in self.values)
