"""How much work a render or a fit takes: every dial that trades speed for accuracy.

What each dial costs and gives is measured by experiments/speed_accuracy, from which the
presets are chosen. Nothing here needs JAX, so that a command line can be parsed before
it starts.
"""

__all__ = ["EFFORTS", "MIN_READINGS", "Effort", "effort_of"]

import dataclasses
import math
import typing
from typing import Any, Literal

MIN_READINGS = 50
"""A fit with fewer readings is refused."""


def _check(name: str, value: Any, kind: Any) -> None:
    """Raise unless a value is of the kind of its field."""
    parts = typing.get_args(kind)
    if type(None) in parts:
        if value is None:
            return
        kind = parts[0]
    if kind is int:
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise ValueError(
                f"{name} must be a whole number of at least 1, got {value!r}"
            )
    elif kind is bool or kind is float:
        if not isinstance(value, kind | (int if kind is float else kind)):
            raise ValueError(f"{name} must be a {kind.__name__}, got {value!r}")
    else:
        allowed = typing.get_args(kind)
        if value not in allowed:
            names = ", ".join(map(str, (*allowed, None) if kind in parts else allowed))
            raise ValueError(f"{name} must be one of {names}, got {value!r}")


@dataclasses.dataclass(frozen=True)
class Effort:
    """The dials, for `render` and the fits; each does without those it has no use for.

    The presets are settings of it. Of a fit they cost, beside `"balanced"`:

    - `"fast"`: 0.79, 0.76 and 0.72 of the time on easy, medium and hard drawn images,
      for 1.26, 1.15 and 1.39 times the radius error; 0.39 on photographs, of which one
      of ten fails.
    - `"balanced"`: 13 ms for a can of 4700 pixels with a mask, on two cores
      (experiments/fit_speed).
    - `"exact"`: 1.6 to 1.8 times the time, for no less error.

    experiments/speed_accuracy has these, and what each dial costs alone.

    Attributes:
        precision: Of all numbers, of a render and of a fit; JAX's own if None. Double
            precision needs `jax_enable_x64` inside `jax.jit`, and nowhere else.
        stride: Every n-th row and column is rendered.
        extent: Whether rays are cast for the whole "frame", or for a "tile" around the
            shape alone: the maps are the same. A traced shape, a scene, and a shape
            that may be seen anywhere take the frame.
        outline: How `render` finds the output `coverage`: "hard", 1 or 0 by the ray
            through the center; or "coverage", the part of the pixel that is covered.
        samples: Rays along each side of a pixel that tell that part, of any shape; with
            1 it is the exact area, of a whole cylinder or a sphere alone.
            Of a traced picture a pixel's color is the mean of as many.
        adaptive: Whether a traced picture takes several samples only where a pixel's
            ray and a neighbor's met different things, or one of them a shadow.
        spacing: A traced picture's rays go through every n-th row and column; a pixel
            between four that met the same takes their mean, and others are cast.
        readings: Most that a fit takes of an object in an image; if None 65536, or
            16384 of a sensor whose errors neighbors share, of which more tell no more.
            A larger image then takes no longer. Half of them are beside the border,
            where they graze the wall and know most of its radius, and the others are
            evenly spread. Fewer than some thousand hardly show that a real sensor's
            errors are correlated: say so.
        starts: First guesses that a fit tries; there are 9 at most.
        all_starts: Whether it tries all of them, or more than one only where the first
            does not explain the readings.
        doubts: Whether a fit doubts its answer: looks for other solutions beside the
            best, for what is not of the object at its region's border, and for errors
            across the rays that nobody told of. Where it does not, a border that
            contradicts the rest is a failure, and so is a bore with a floor. Without a
            mask it does: what is found goes on to what lies beside.
        tolerance: Length of a step at which a fit ends, in standard deviations. Where
            it is differentiated it is at most 0.02, and of a frustum, whose taper
            settles slowly, 0.2.
        max_steps: Of the solver, in all stages of a fit, of which it takes a few more
            if need be to have gone through all.
        kernel: Robust loss: "pseudo_huber", "cauchy" or "geman_mcclure"; or "squares",
            which is not robust.

    Raises:
        ValueError: A value is not allowed, or two do not go together.
    """

    precision: Literal["float32", "float64"] | None = None
    stride: int = 1
    extent: Literal["frame", "tile"] = "frame"
    outline: Literal["hard", "coverage"] = "coverage"
    samples: int = 1
    adaptive: bool = True
    spacing: int = 1
    readings: int | None = None
    starts: int = 8
    all_starts: bool = False
    doubts: bool = True
    tolerance: float = 1.0
    max_steps: int = 60
    kernel: Literal["pseudo_huber", "cauchy", "geman_mcclure", "squares"] = (
        "geman_mcclure"
    )

    def __post_init__(self):
        for field in dataclasses.fields(self):
            _check(field.name, getattr(self, field.name), field.type)
        if not (math.isfinite(self.tolerance) and self.tolerance > 0):
            raise ValueError(
                "tolerance must be a positive number of standard deviations, got "
                f"{self.tolerance}"
            )
        if self.readings is not None and self.readings < MIN_READINGS:
            raise ValueError(
                f"readings must be at least {MIN_READINGS}, got {self.readings}"
            )
        if self.outline == "hard" and self.samples > 1:
            raise ValueError(
                'samples must be 1 with outline="hard", which asks the center of each '
                f"pixel alone, got {self.samples}"
            )


EFFORTS: dict[str, tuple[str, Effort]] = {
    "fast": (
        "1024 readings, at most 7 steps, no doubts; every second row and column.",
        Effort(
            stride=2,
            extent="tile",
            outline="hard",
            readings=1024,
            doubts=False,
            tolerance=5.0,
            max_steps=7,
        ),
    ),
    "balanced": (
        "Up to 65536 readings, 16384 of a sensor whose errors neighbors share; more "
        "starts where the first does not explain them.",
        Effort(),
    ),
    "exact": (
        "Double precision, up to a million readings, steps to the last digit.",
        # Not all starts: they take 8 times as long, and where the first explains the
        # image they change nothing (experiments/speed_accuracy).
        Effort(precision="float64", tolerance=0.02, readings=1 << 20),
    ),
}
"""By name: what it does, and the dials."""


def effort_of(effort: Any) -> Effort:
    """The dials of a preset's name, or the dials that are given.

    Raises:
        ValueError: It is neither.
    """
    if isinstance(effort, Effort):
        return effort
    if not isinstance(effort, str) or effort not in EFFORTS:
        raise ValueError(
            f"effort must be an Effort or one of {', '.join(EFFORTS)}, got {effort!r}"
        )
    return EFFORTS[effort][1]
