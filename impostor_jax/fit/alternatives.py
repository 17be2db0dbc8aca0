"""Other solutions that explain an image almost as well as the one that is returned."""

__all__ = ["MOST_ALTERNATIVES", "Alternatives", "Named", "no_alternatives"]

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.primitives.base import AbstractPrimitive

MOST_ALTERNATIVES = 2
"""How many are told of."""

Named = dict[str, Array | np.ndarray]
"""Parameters of shapes by name; those that lie far off are NumPy's."""


class Alternatives(eqx.Module):
    """Solutions beside a fit's own, the likeliest first.

    There are always `MOST_ALTERNATIVES`, so that fits can be stacked; where there is
    none, the weight is 0 and the shape the fit's own, which a mean over them leaves.

    Attributes:
        shape: In the world frame, each like the fit's.
        weight: Posterior probability of each; what they lack to 1 is the fit's own.
    """

    shape: AbstractPrimitive
    weight: Float[Array, "*batch k"]

    def told(
        self, named: Callable[[AbstractPrimitive], Named]
    ) -> list[tuple[float, Named]]:
        """Weight and named values of those that there are; needs those of one fit.

        Args:
            named: Values of shapes by name.
        """
        weights, values = np.asarray(self.weight), named(self.shape)
        return [
            (float(weights[k]), {name: value[k] for name, value in values.items()})
            for k in np.flatnonzero(weights)
        ]


def no_alternatives(shape: Any) -> Alternatives:
    """Those of a shape that has none.

    Args:
        shape: A single one, which stands in for each.
    """
    count = MOST_ALTERNATIVES
    return Alternatives(
        shape=jax.tree.map(
            lambda part: jnp.broadcast_to(part, (count, *part.shape)), shape
        ),
        weight=jnp.zeros(count, jnp.result_type(*jax.tree.leaves(shape))),
    )
