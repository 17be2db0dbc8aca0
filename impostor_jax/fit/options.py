"""What a fit may be asked beside the image: resolved once, for all that fit."""

__all__ = ["Errors", "MaskMeaning", "Options", "Scale"]

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Literal, get_args

from impostor_jax.arguments import one_of
from impostor_jax.effort import EFFORTS, Effort
from impostor_jax.sensor.base import AbstractDepthNoise
from impostor_jax.sensor.bias import is_none

MaskMeaning = Literal["region", "outline"]
"""What the edge of a mask says."""

Scale = Literal["estimated", "fixed"]
"""What the width of the robust loss is measured by."""

Errors = Literal["independent", "correlated"]
"""How readings of neighboring pixels err."""


@dataclasses.dataclass(frozen=True)
class Options:
    """Options of a fit, which `fit_cylinder` explains: each checked, or its default.

    Raises:
        ValueError: An option has a value that is not allowed.
    """

    fixed: Sequence[str] = ()
    prior: Mapping[str, Any] | None = None
    mask_meaning: MaskMeaning = "region"
    scale: Scale = "estimated"
    errors: Errors | None = None
    effort: Effort = EFFORTS["balanced"][1]
    pose_sigma: Any = None

    def __post_init__(self) -> None:
        if isinstance(self.fixed, str):
            raise ValueError(f"fixed must be a sequence of names, got {self.fixed!r}")
        one_of("mask_meaning", self.mask_meaning, get_args(MaskMeaning))
        one_of("scale", self.scale, get_args(Scale))
        if self.errors is not None:
            one_of("errors", self.errors, get_args(Errors))

    def correlated(self, noise: AbstractDepthNoise) -> bool:
        """Whether errors of neighbors are taken for correlated."""
        if self.errors is not None:
            return self.errors == "correlated"
        bias = noise.bias
        if bias.lean is not None:
            # Copies have the same error.
            return True
        return not (is_none(bias.window_reach) or bias.fields)
