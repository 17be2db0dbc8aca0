"""Whether readings exclude what a caller states: a prior, or a value that is held.

A narrow prior wins over any number of readings, and a held value is never asked. So the
shape is fitted once more without them, from where the first fit ended, by the same
compiled program. What the readings say alone is independent of what was stated, and
their difference is tested against both deviations (Wald's test). Neither is the first
fit's pull a measure of it: of readings far off, a robust loss counts little.
"""

__all__ = ["tested_by_readings"]

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.fit.body import AbstractBody
from impostor_jax.fit.budget import ANGLES
from impostor_jax.fit.fittable import Fittable
from impostor_jax.fit.prior import OWN
from impostor_jax.fit.request import FitRequest
from impostor_jax.fit.result import Fit
from impostor_jax.fit.status import FitStatus
from impostor_jax.fit.text import millimeters
from impostor_jax.geometry.so3 import tangent_basis, turn_of

MOST_APART = 5.0
"""Deviations from which readings exclude a value: by chance once in 2e6 fits for a
number, in 7e4 for a center."""

Fitted = Callable[[FitRequest], Fit]
"""Fit to the same readings with other options and another start."""


class Stated(NamedTuple):
    """A parameter as a caller states it.

    Attributes:
        name: Of the parameter.
        value: In the world frame.
        deviation: In meters or radians; 0 of what is held.
    """

    name: str
    value: Float[np.ndarray, "..."]
    deviation: float


def tested_by_readings(fit: Fit, request: FitRequest, fitted: Fitted) -> Fit:
    """The fit, or a failed one where readings exclude what was stated.

    All that is stated is left out at first. Where the readings then leave the shape
    open, as an outline does its size, each is left out by itself.

    Args:
        fit: With priors and held values, concrete.
        request: What it was asked; held values are those of its start.
        fitted: How to make it anew.
    """
    all_stated = _all_stated(request)
    if not all_stated:
        return fit
    left_out: list[Sequence[Stated]] = [all_stated]
    if len(all_stated) > 1:
        left_out += [[one] for one in all_stated]
    for stated in left_out:
        alone = _fit_without(stated, fit, request, fitted)
        if not alone.is_shape:
            continue
        told = [_contradiction(request.kind, one, alone) for one in stated]
        excluded = [text for text in told if text is not None]
        if excluded:
            return fit.contradicted("; ".join(excluded) + ": one of them is wrong.")
        if stated is all_stated:
            break
    return fit


def _all_stated(request: FitRequest) -> list[Stated]:
    options = request.options
    stated = [
        Stated(name, np.asarray(value, np.float64), float(deviation))
        for name, (value, deviation) in (options.prior or {}).items()
    ]
    if options.fixed:
        held = request.kind.body.of(request.initial)
        stated += [
            Stated(name, np.asarray(_value(held, name), np.float64), 0.0)
            for name in options.fixed
        ]
    return stated


def _fit_without(
    stated: Sequence[Stated], fit: Fit, request: FitRequest, fitted: Fitted
) -> Fit:
    """What readings say where something is not stated.

    From where a wrong value led, they may not lead back: then from the first start.
    """
    names, options = {one.name for one in stated}, request.options
    prior = {name: x for name, x in (options.prior or {}).items() if name not in names}
    fixed = tuple(name for name in options.fixed if name not in names)
    others = dataclasses.replace(options, fixed=fixed, prior=prior or None)
    request = request._replace(options=others)
    if fit.status.has_numbers:
        found = fitted(request._replace(initial=fit.shape))
        if found.is_shape or found.status is FitStatus.UNDETERMINED:
            return found
    return fitted(request)


def _contradiction(kind: Fittable, stated: Stated, alone: Fit) -> str | None:
    """What is stated beside what readings say, in words; None if they may agree.

    Coordinates that the readings leave open exclude nothing.
    """
    body = kind.body.of(alone.shape)
    off, names = _apart(stated, body)
    places = [alone.coordinates.index(name) for name in names]
    covariance = np.asarray(alone.covariance, np.float64)[np.ix_(places, places)]
    known = np.isfinite(np.diagonal(covariance))
    covariance = covariance[np.ix_(known, known)]
    total = covariance + np.eye(len(covariance)) * stated.deviation**2
    away = float(np.sqrt(off[known] @ np.linalg.pinv(total) @ off[known]))
    if not away > MOST_APART:
        return None
    read = np.asarray(_value(body, stated.name), np.float64)
    if stated.name == "axis" and read @ stated.value < 0:
        read = -read
    said = np.sqrt(np.diagonal(covariance).max())
    source = "fixed" if stated.deviation == 0 else "prior"
    return (
        f"{source} states {stated.name} as "
        f"{_with_unit(stated.name, stated.value, stated.deviation)}, the readings say "
        f"{_with_unit(stated.name, read, said)}, {away:.0f} deviations apart"
    )


def _apart(
    stated: Stated, body: AbstractBody
) -> tuple[Float[np.ndarray, " k"], tuple[str, ...]]:
    """Stated value less that of a body, in coordinates of its covariance."""
    name, value = stated.name, stated.value
    if name == "axis":
        axis, basis = _axis_and_across(body)
        toward = value / np.linalg.norm(value)
        # Either sign will do.
        return basis @ toward * (1 if toward @ axis > 0 else -1), body.coordinates[name]
    own = np.asarray(_value(body, name), np.float64)
    if name == "rotation":
        turn = turn_of(jnp.asarray(own.T @ value))
        return np.asarray(turn, np.float64), body.coordinates[name]
    away = np.atleast_1d(value - own)
    if name in body.coordinates:
        return away, body.coordinates[name]
    if "along_edges" in body.coordinates:
        frame = np.asarray(_value(body, "frame"), np.float64)
        return frame @ away, body.coordinates["along_edges"]
    # The center of a shape with an axis.
    axis, basis = _axis_and_across(body)
    names = (*body.coordinates["across_axis"], *body.coordinates["along_axis"])
    return np.append(basis @ away, axis @ away), names


def _axis_and_across(
    body: AbstractBody,
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "2 3"]]:
    """A body's axis and the two directions across it that coordinates go along."""
    axis = _value(body, "axis")
    return np.asarray(axis, np.float64), np.asarray(tangent_basis(axis), np.float64)


def _value(body: AbstractBody, name: str) -> Array:
    """A parameter that this kind of body has."""
    return getattr(body, OWN.get(name, name))


def _with_unit(name: str, value: Any, deviation: float) -> str:
    """A value and its deviation, for a reader."""
    if name in ANGLES:
        numbers = " ".join(f"{x:.3f}" for x in np.ravel(value))
        text, unit, spread = numbers, "degrees", f"{np.degrees(deviation):.2g}"
    else:
        text, unit, spread = millimeters(value), "mm", f"{1e3 * deviation:.2g}"
    if deviation == 0:
        return text if name in ANGLES else f"{text} {unit}"
    return f"{text} +- {spread} {unit}"
