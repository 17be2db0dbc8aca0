"""Flags that say how much work a command does: a preset, and dials that differ."""

__all__ = ["Dials", "EffortName", "chosen_effort"]

import dataclasses
from typing import TYPE_CHECKING, Literal

from impostor_jax.effort import EFFORTS, Effort

EffortName = Literal["fast", "balanced", "exact"]

if TYPE_CHECKING:
    Dials = Effort
else:
    # A flag for each dial; None where it is not given.
    Dials = dataclasses.make_dataclass(
        "Dials",
        [(dial.name, dial.type | None, None) for dial in dataclasses.fields(Effort)],
        frozen=True,
        namespace={"__doc__": Effort.__doc__},
    )


def chosen_effort(preset: EffortName, dials: Dials) -> Effort:
    """The preset with the dials that are given.

    Raises:
        ValueError: A dial has a value that is not allowed, or that does not go with the
            others.
    """
    given = {dial: value for dial, value in vars(dials).items() if value is not None}
    return dataclasses.replace(EFFORTS[preset][1], **given)
