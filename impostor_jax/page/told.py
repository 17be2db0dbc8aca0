"""What a page tells of a fit: its numbers, each with the digits that it knows."""

__all__ = ["Number", "notes_of", "numbers_of", "track_numbers"]

import math
from typing import Any, NamedTuple

import numpy as np

from impostor_jax.fit.result import UNSEEN, named_values
from impostor_jax.fit.text import plain
from impostor_jax.page.shown import Shown
from impostor_jax.track.track import Track

DIGITS = 3
"""Behind the point of millimeters, where no standard deviation tells how many."""

MOST_DIGITS = 6


class Number(NamedTuple):
    """A line of a table, as text."""

    name: str
    value: str
    std: str
    unit: str


def numbers_of(shown: Shown) -> list[Number]:
    """Lines of a fit: of a shape, where there is one, and of how well it fits."""
    fit, lines = shown.fit, []
    parts = {"confidence": shown.confidence, "visible": shown.visible}
    for name, part in parts.items():
        if part is not None:
            lines.append(Number(name, f"{part:.2f}", "", ""))
    if fit.is_shape:
        for name, (value, std) in fit.told.items():
            lines += _parameter(name.replace("_", " "), value, std)
        lines += [
            Number("rms residual", f"{1e3 * float(fit.rms):.{DIGITS}f}", "", "mm"),
            Number("chi-squared", f"{float(fit.chi2):.2f}", "", ""),
            Number("inliers", f"{fit.num_inliers}", "", ""),
        ]
    return [*lines, Number("pixels used", f"{int(fit.num_pixels)}", "", "")]


def track_numbers(track: Track) -> list[Number]:
    """Lines of a track, the same ones of each."""
    shape, std = track.cylinder, track.std
    speed = float(np.linalg.norm(track.velocity))
    along = track.velocity / speed if speed else np.eye(3)[2]
    of_velocity = [name.startswith("velocity") for name in track.coordinates]
    spread = track.covariance[np.ix_(of_velocity, of_velocity)]
    deviation = float(np.sqrt(along @ spread @ along))
    return [
        *_parameter("radius", shape.radius, std.radius),
        *_parameter("height", shape.height, std.height),
        *_parameter("center", shape.center, std.center),
        *_parameter("axis", shape.axis, std.axis),
        Number("speed", f"{speed:.{_digits(deviation)}f}", _length(deviation), "m/s"),
        Number("images", f"{track.num_fits}", "", ""),
        Number("visible", f"{track.visible:.2f}", "", ""),
    ]


def notes_of(shown: Shown) -> list[str]:
    """Sentences: what is behind the status, and what else a reader must know."""
    fit = shown.fit
    notes = [fit.reason]
    if not fit.is_shape:
        return notes
    for weight, values in fit.alternatives.told(named_values):
        told = ", ".join(plain(name, value) for name, value in values.items())
        notes.append(f"With {100 * weight:.1f} % it is another: {told}.")
    if not fit.height_observed:
        notes.append(UNSEEN[type(fit.shape)].split(";")[0] + ".")
    return notes


def _parameter(name: str, value: Any, std: Any) -> list[Number]:
    """Lines of a length, a point, an axis or a rotation."""
    values, stds = (np.asarray(x, float) for x in (value, std))
    if name == "rotation":
        turn = ", ".join(_length(x) for x in np.degrees(stds))
        rows = zip("xyz", values.T, strict=True)
        told = [(letter, " ".join(f"{x:.5f}" for x in row)) for letter, row in rows]
        return [
            *(Number(f"edge {letter}", text, "", "") for letter, text in told),
            Number("rotation", "", turn, "\N{DEGREE SIGN}"),
        ]
    if name == "axis":
        tilt = ", ".join(_length(x) for x in np.degrees(stds))
        parts = zip("xyz", values, strict=True)
        return [
            *(Number(f"axis {letter}", f"{x:.5f}", "", "") for letter, x in parts),
            Number("axis tilt", "", tilt, "\N{DEGREE SIGN}"),
        ]
    if values.ndim == 0:
        return [_line(name, float(values), float(stds))]
    return [
        _line(f"{name} {letter}", float(x), float(s))
        for letter, x, s in zip("xyz", values, stds, strict=True)
    ]


def _line(name: str, value: float, std: float) -> Number:
    """Line of a length in meters."""
    value, std = 1e3 * value, 1e3 * std
    digits = _digits(std)
    text = "held" if std == 0 else _length(std)
    return Number(name, f"{value:.{digits}f}", text, "mm")


def _length(std: float) -> str:
    """A standard deviation with two digits that count."""
    return f"{std:.{_digits(std)}f}" if math.isfinite(std) else "not determined"


def _digits(std: float) -> int:
    """Digits behind the point of a number of which two are uncertain."""
    if not (math.isfinite(std) and std > 0):
        return DIGITS
    return min(max(1 - math.floor(math.log10(std)), 0), MOST_DIGITS)
