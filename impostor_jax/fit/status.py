"""How a fit may end."""

__all__ = ["STATUSES", "FitStatus", "code_of_first"]

import enum
from collections.abc import Mapping

import jax.numpy as jnp
from jaxtyping import Array, Bool, Int


class FitStatus(enum.StrEnum):
    """How a fit ended; only CONVERGED is a success.

    AMBIGUOUS is no failure of the solver: `Fit.alternatives` has the other solutions,
    and the standard deviations cover them.
    """

    CONVERGED = "converged"
    STEP_LIMIT = "step_limit"
    NO_FIRST_GUESS = "no_first_guess"
    POOR_FIT = "poor_fit"
    UNDETERMINED = "undetermined"
    AMBIGUOUS = "ambiguous"
    NOT_FINITE = "not_finite"
    CONTRADICTED = "contradicted"

    @property
    def meaning(self) -> str:
        """One sentence for a reader."""
        return _MEANINGS[self]

    @property
    def has_numbers(self) -> bool:
        """Whether the fit ended with numbers, right or wrong, for its shape."""
        return self not in (FitStatus.NO_FIRST_GUESS, FitStatus.NOT_FINITE)


_MEANINGS = {
    FitStatus.CONVERGED: "The fit converged.",
    FitStatus.STEP_LIMIT: "The solver reached its step limit before it converged.",
    FitStatus.NO_FIRST_GUESS: "No shape lies near the readings: no first guess.",
    FitStatus.POOR_FIT: "The readings do not lie on the fitted shape.",
    FitStatus.UNDETERMINED: "The readings do not determine size and place.",
    FitStatus.AMBIGUOUS: "Two solutions explain the readings.",
    FitStatus.NOT_FINITE: "The solver met a number that is not finite.",
    FitStatus.CONTRADICTED: "The readings exclude what was stated, or the outline.",
}

STATUSES = tuple(FitStatus)
"""Order of the integer codes in which a compiled fit carries its status."""


def code_of_first(wrong: Mapping[FitStatus, Bool[Array, ""]]) -> Int[Array, ""]:
    """Code of the first status that holds, or of success where none does."""
    codes = [jnp.array(STATUSES.index(status)) for status in wrong]
    right = jnp.array(STATUSES.index(FitStatus.CONVERGED))
    return jnp.select(list(wrong.values()), codes, right)
