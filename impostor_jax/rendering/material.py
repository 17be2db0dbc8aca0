"""What surfaces are made of: color and highlight, and how they mirror and refract.

What no shape of a scene has is not in the program that traces it: a field that is None
of all materials is left out.
"""

__all__ = ["DEFAULTS", "Material", "stacked"]

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from impostor_jax.arguments import check_positive, float_array, is_concrete

DEFAULTS = {
    "exponent": -1.0,
    "reflect": 0.0,
    "transmit": 0.0,
    "ior": 1.0,
    "fresnel": 0.0,
}
"""Of a material without what another has."""

GLASS = 1.5
"""Index of refraction of what lets light through, unless it is given."""


class Material(eqx.Module):
    """Material of a shape, or of each of many.

    A part `reflect` of the color is that of the ray which the surface mirrors, a part
    `transmit` that of the ray which goes on behind it, bent by Snell's law, and what is
    left the surface's own under the lights. Where the law has no such ray, all that
    would go through is mirrored.

    Args:
        color: Red, green and blue that a white light makes it, linear, from 0,
            (*batch, 3).
        exponent: Of the highlight, which shrinks as it grows, from 0; None for none.
        reflect: From 0 to 1; None for none at all.
        transmit: From 0 to 1; None for none at all.
        ior: Index of refraction inside, over that outside; 1.5 if not given. What has
            no inside, as a sheet of triangles, has it behind the side that its normal
            points to.
        fresnel: Whether the part that is mirrored grows with the angle of incidence at
            the cost of what goes through, as of unpolarized light at glass.

    Raises:
        ValueError: A concrete value is out of range, or a shape does not fit.

    References:
        Whitted (1980), An improved illumination model for shaded display.
    """

    color: Float[Array, "*batch 3"]
    exponent: Float[Array, "*batch"] | None
    reflect: Float[Array, "*batch"] | None
    transmit: Float[Array, "*batch"] | None
    ior: Float[Array, "*batch"] | None
    fresnel: Float[Array, "*batch"] | None

    def __init__(
        self,
        color: Any = (1.0, 1.0, 1.0),
        exponent: Any = None,
        reflect: Any = None,
        transmit: Any = None,
        ior: Any = None,
        fresnel: bool = False,
    ):
        self.color = float_array("color", color, (3,))
        batch = self.color.shape[:-1]

        def numbers(name: str, value: Any) -> Float[Array, "*batch"] | None:
            if value is None:
                return None
            value = float_array(name, value, ())
            if value.shape not in ((), batch):
                raise ValueError(
                    f"{name} must have the shape {batch} of color's batch, got "
                    f"{value.shape}"
                )
            return jnp.broadcast_to(value, batch)

        if ior is not None and transmit is None:
            raise ValueError(f"transmit must be given with an ior, got None and {ior}")
        if not isinstance(fresnel, bool) or (fresnel and transmit is None):
            raise ValueError(
                "fresnel must be True or False, and False without transmit, got "
                f"{fresnel}"
            )
        self.exponent = numbers("exponent", exponent)
        self.reflect = numbers("reflect", reflect)
        self.transmit = numbers("transmit", transmit)
        ior = GLASS if ior is None and transmit is not None else ior
        self.ior = numbers("ior", ior)
        self.fresnel = numbers("fresnel", 1.0 if fresnel else None)
        self._check()

    def _check(self) -> None:
        """Raise unless all that is concrete is in range."""
        for name in ("color", "exponent", "reflect", "transmit"):
            value = getattr(self, name)
            if value is not None and is_concrete(value) and bool((value < 0).any()):
                raise ValueError(f"{name} must not be negative, got {value}")
        if self.ior is not None:
            check_positive("ior", self.ior, "a ratio of two indices of refraction")
        parts = [part for part in (self.reflect, self.transmit) if part is not None]
        if is_concrete(parts):
            total = sum(np.asarray(part, float) for part in parts)
            # 0.9 + 0.1 is more than 1 in some precision.
            if np.any(total > 1 + 1e-6):
                raise ValueError(
                    "reflect and transmit must be at most 1 together, got "
                    f"{self.reflect} and {self.transmit}"
                )


def stacked(materials: Material | Sequence[Material]) -> Material:
    """The materials of all shapes of a scene, (n,).

    Args:
        materials: One of each shape; a batch counts as many.

    Raises:
        ValueError: Something is no material, or there is none.
    """
    given = [materials] if isinstance(materials, Material) else materials
    if not isinstance(given, Sequence) or not given:
        raise ValueError(f"materials must be a sequence of ij.Material, got {given!r}")
    for one in given:
        if not isinstance(one, Material):
            raise ValueError(f"materials must be ij.Material, got {type(one).__name__}")
        if one.color.ndim > 2:
            raise ValueError(
                "materials must be single ones or batches (n,), got a batch of shape "
                f"{one.color.shape[:-1]}"
            )
    batches = [
        one if one.color.ndim == 2 else jax.tree.map(lambda x: x[None], one)
        for one in given
    ]
    fields = {
        name: _joined(batches, name, default)
        for name, default in DEFAULTS.items()
        if any(getattr(one, name) is not None for one in batches)
    }
    return eqx.tree_at(
        lambda one: [getattr(one, name) for name in fields],
        Material(jnp.concatenate([one.color for one in batches])),
        list(fields.values()),
        is_leaf=lambda x: x is None,
    )


def _joined(batches: list[Material], name: str, default: float) -> Float[Array, " n"]:
    """A field of all materials, of which some do not have it."""
    parts = []
    for one in batches:
        value = getattr(one, name)
        count = one.color.shape[0]
        parts.append(jnp.full(count, default) if value is None else value)
    return jnp.concatenate(parts)
