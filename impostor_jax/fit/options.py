"""What a fit may be asked beside the image: written once, for all that fit."""

__all__ = ["FitOptions", "Options"]

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, TypedDict

from impostor_jax.arguments import one_of
from impostor_jax.effort import EFFORTS, Effort, effort_of
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.bias import is_none


class FitOptions(TypedDict, total=False):
    """Options of a fit, by name, in the call of `fit_cylinder` and its like."""

    fixed: Sequence[str]
    """Names of the parameters that keep the value they have in `initial`; none if not
    given. A cylinder has center, axis, radius and height; a frustum radius1 and radius2
    in place of radius, and its center is the midpoint of the axis; a tube outer_radius
    and inner_radius; a sphere has center and radius. A value that the readings exclude
    by more than five standard deviations makes the fit `contradicted`."""
    prior: Mapping[str, Any] | None
    """For any of these names, expected value and standard deviation in the world frame,
    in meters and (for the axis) radians, as in `{"radius": (0.04, 0.001)}`; for radius1
    and radius2 with `initial` only. Not for what is `fixed`. Its deviation and that of
    the readings are tested together: five apart, the fit is `contradicted`."""
    mask_meaning: str
    """"region", the default: any subset of the object's pixels, its edge has no
    meaning; where an end stands out before what lies behind, it is known to a pixel, or
    to as many as the sensor mixes at edges. "outline": the edge is the object's
    silhouette, where no occluder stands in front of it; without depth it must be."""
    scale: str
    """Whether the width of the robust loss is "fixed" to standard deviations of the
    sensor or grows with the "estimated" spread of the residuals, the default."""
    errors: str | None
    """Whether readings err "independent" of each other or "correlated" between
    neighboring pixels as those of real sensors do; decides which covariance is
    reported. What a sensor says of smooth errors (`CorrelatedNoise`) is counted in any
    case; by default one with a `MatchingWindow` that says nothing of them errs
    correlated, others independent. Where the readings contradict independence, they are
    taken for correlated; in a traced fit only if that is said."""
    effort: Effort | str
    """How much work it takes: "fast", "balanced", the default, or "exact", or an
    `Effort` with a setting of each dial."""


@dataclasses.dataclass(frozen=True)
class Options:
    """The same, resolved: each with its value or its default."""

    fixed: Sequence[str] = ()
    prior: Mapping[str, Any] | None = None
    mask_meaning: str = "region"
    scale: str = "estimated"
    errors: str | None = None
    effort: Effort = EFFORTS["balanced"][1]

    def correlated(self, noise: AbstractDepthNoise) -> bool:
        """Whether errors of neighbors are taken for correlated."""
        if self.errors is not None:
            return self.errors == "correlated"
        bias = noise.bias
        if bias.lean is not None:
            # Copies have the same error.
            return True
        return not (is_none(bias.window_reach) or bias.fields)

    @staticmethod
    def of(given: Mapping[str, Any]) -> "Options":
        """Resolve what is given.

        Raises:
            TypeError: An option is unknown.
            ValueError: One has a value that is not allowed.
        """
        names = [field.name for field in dataclasses.fields(Options)]
        for name in given:
            if name == "test_taper":
                raise TypeError("test_taper is no option: call ij.test_taper(fit)")
            if name not in names:
                raise TypeError(
                    f"a fit has the options {', '.join(names)}, got {name!r}"
                )
        effort = effort_of(given.get("effort", Options.effort))
        options = Options(**{**given, "effort": effort})
        if isinstance(options.fixed, str):
            raise ValueError(
                f"fixed must be a sequence of names, got {options.fixed!r}"
            )
        one_of("mask_meaning", options.mask_meaning, ("region", "outline"))
        one_of("scale", options.scale, ("estimated", "fixed"))
        if options.errors is not None:
            one_of("errors", options.errors, ("independent", "correlated"))
        return options
