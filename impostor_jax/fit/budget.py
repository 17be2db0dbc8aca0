"""Standard deviations of a fit by name, and what they are made of."""

__all__ = ["ANGLES", "BUDGET", "Budget", "Deviations", "Told", "Values", "if_known"]

from collections import OrderedDict
from collections.abc import Mapping
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from impostor_jax.arguments import is_concrete
from impostor_jax.text import described, text_or_repr

Values = Float[Array, "..."] | Float[np.ndarray, "..."]

ANGLES: tuple[str, ...] = ("axis", "rotation")
"""What is in radians; all else is in meters."""


class Deviations(eqx.Module):
    """Standard deviations by name, as in `std.radius`; `inf` where undetermined.

    Each is in meters, `axis` and `rotation` in radians; 0 is what was held.

    Of any shape there are its own parameters: `center`, `radius`, `height`, or `p1`,
    `p2`, `radius1` and `radius2`, or `outer_radius` and `inner_radius`, or `size` and
    `rotation`, which are along and about a box's own axes. Points are along x, y and z
    of the world. Where an end is not seen, the place along the axis is free, so every
    direction that the axis has a part in is undetermined, and so is a frustum's radius
    at that end. So there are, too:

    * `axis`: Along the two vectors of `tangent_basis(axis)`.
    * `across_axis`: Of the center along the same two; determined even where the ends
      are not.
    * `along_axis`: Of the center along the axis.
    * `along_edges`: Of a box's center along its own axes.

    Attributes:
        vector: All of them, one after the other: each output of a compiled program
            costs its time and its compilation.
        names: Of each entry; those of one name are together, alone if it is a number.
    """

    vector: Float[Array, "*batch n"] | Float[np.ndarray, "*batch n"]
    names: tuple[str, ...] = eqx.field(static=True)

    @staticmethod
    def of(values: Mapping[str, Any]) -> "Deviations":
        """Numbers and vectors by name."""
        parts = {name: jnp.atleast_1d(value) for name, value in values.items()}
        names = np.repeat([*parts], [len(part) for part in parts.values()])
        return Deviations(jnp.concatenate([*parts.values()]), tuple(names.tolist()))

    @property
    def values(self) -> OrderedDict[str, Values]:
        """By name; of what is concrete they are NumPy's."""
        return OrderedDict((name, getattr(self, name)) for name in self.names)

    def __getattr__(self, name: str) -> Values:
        # Copies and trees are made without a field at first.
        names = self.__dict__.get("names", ())
        if name not in names:
            known = ", ".join(dict.fromkeys(names))
            raise AttributeError(
                f"std has the names {known}, got {name!r}", name=name, obj=self
            )
        vector = np.asarray(self.vector) if is_concrete(self.vector) else self.vector
        first, count = names.index(name), names.count(name)
        if count == 1:
            return vector[..., first]
        return vector[..., first : first + count]

    def __str__(self) -> str:
        units = dict.fromkeys(ANGLES, "rad")
        return text_or_repr(self, lambda: described(self, units, self.values))


BUDGET: tuple[str, ...] = (
    "noise",
    "correlation",
    "warp",
    "scale",
    "alignment",
    "poses",
    "outline",
    "prior",
    "form",
    "alternatives",
)
"""What standard deviations are made of."""


class Budget(eqx.Module):
    """What standard deviations are made of, as in `std_budget["scale"].radius`.

    The squares of all parts add up to that of `std`, but for `correlation` where that
    takes from it, which is 0 then.

    * `noise`: What each reading errs by on its own.
    * `correlation`: What residuals of neighbors have in common, beyond that.
    * `warp`: Smooth errors that the sensor says it has.
    * `scale`: Errors of all depths alike, in so far as no prior tells them; without
      depth, of a mask's edge all along.
    * `alignment`: What walls lean by where readings were copied to several pixels.
    * `poses`: What poses of cameras err by, and what views disagree by beyond that.
    * `outline`: The place of the ends, and of a silhouette, in the image.
    * `prior`: What was expected beforehand.
    * `form`: That a wall departs from the shape's, where the readings say so.
    * `alternatives`: That another solution may be the true one.

    Attributes:
        parts: One a row, as of `BUDGET`.
        names: As of `Deviations`.
    """

    parts: Float[Array, "*batch b n"] | Float[np.ndarray, "*batch b n"]
    names: tuple[str, ...] = eqx.field(static=True)

    def __getitem__(self, name: str) -> Deviations:
        if name not in BUDGET:
            parts = ", ".join(BUDGET)
            raise KeyError(f"std_budget has the parts {parts}, got {name!r}")
        # NumPy's of what is concrete, of which JAX takes half a millisecond.
        parts = np.asarray(self.parts) if is_concrete(self.parts) else self.parts
        return Deviations(parts[..., BUDGET.index(name), :], self.names)

    def having(self, name: str, part: Values) -> "Budget":
        """The same with another part."""
        parts = jnp.asarray(self.parts).at[..., BUDGET.index(name), :].set(part)
        return Budget(parts, self.names)

    def of(self, name: str) -> dict[str, Values]:
        """What the standard deviation of one parameter is made of, but what is 0."""
        shares = {part: getattr(std, name) for part, std in self.some.items()}
        return {part: std for part, std in shares.items() if np.any(std)}

    @property
    def some(self) -> dict[str, Deviations]:
        """The parts that are not 0; needs a single, concrete result."""
        return {
            part: Deviations(values, self.names)
            for part, values in zip(BUDGET, np.asarray(self.parts), strict=True)
            if np.any(values)
        }

    def __str__(self) -> str:
        return text_or_repr(self, self._text)

    def _text(self) -> str:
        return "\n".join(f"{part}: {std}" for part, std in self.some.items())


Told = TypeVar("Told", Deviations, Budget)


def if_known(is_known: Bool[Array, ""], told: Told) -> Told:
    """Deviations, or a budget; infinite where nothing is known."""
    return jax.tree.map(lambda x: jnp.where(is_known, x, jnp.inf), told)
