"""How a wall departs from that of the shape that was fitted to it.

A stem is oval, a cup is a cone, a can is dented. The cylinder that explains the front
of an oval best may miss its radius by thirty deviations and leave residuals of a
chi-squared of 1: what the other readings say of the radius rests on its being round. So
each of six patterns in which a wall moves outward is looked for in the residuals. Where
the noise hardly makes them, a fit is as unsure as if nobody knew of the wall but that
it may be deformed so.

A pattern's derivative is that of the radius, times how far it moves the wall at each
reading. Where that is, tells the derivative in the other coordinates: across the axis
the wall moves outward by the cosine of the direction, and tilted by that times the
place along the axis.
"""

__all__ = ["BY_CHANCE", "DEPARTURES", "Form", "departures_of", "no_form"]

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float

from impostor_jax.numerics import product, safe_divide
from impostor_jax.text import text_or_repr

DEPARTURES = ("taper", "barrel", "oval", "oval", "bend", "bend")
"""Names of the patterns; two that differ in direction have one."""

USUAL = 0.05
"""Standard deviation, in radii, of departures of what one would call a cylinder."""

BY_CHANCE = 22.5
"""Chi-squared of six departures above which a wall is taken to depart: of a cylinder
once in 1000 fits, which then says that it is less sure than it could be."""

TOLD = 3.0
"""Deviations from which a reader is told of a departure."""


class Form(eqx.Module):
    """Departures of a wall from that of the shape that was fitted, over its radius.

    Of a frustum, whose taper is its own, that is none.

    * `taper`: Growth of the radius from the middle of the wall to its end.
    * `barrel`: Growth at both ends.
    * `oval`: Growth along one direction across the axis, and shrinking across that: as
      (a - b) / (a + b) of the half axes of an ellipse.
    * `bend`: Motion of both ends across the axis, against the middle.

    Attributes:
        value: Each of `DEPARTURES`.
        deviation: Their standard deviations.
        chi2: Of all six together; of a wall that departs in none it is chi-squared with
            as many degrees of freedom, or less.
    """

    value: Float[Array, "*batch 6"]
    deviation: Float[Array, "*batch 6"]
    chi2: Float[Array, "*batch"]

    @property
    def departs(self) -> Bool[Array, "*batch"]:
        """Whether the noise hardly explains them: standard deviations allow for it."""
        return self.chi2 > BY_CHANCE

    @property
    def sizes(self) -> dict[str, tuple[float, float]]:
        """Size and deviation of each by name; needs a single, concrete result."""
        value, deviation = (np.asarray(x, float) for x in (self.value, self.deviation))
        found = {}
        for name in dict.fromkeys(DEPARTURES):
            own = [k for k, other in enumerate(DEPARTURES) if other == name]
            size = float(np.linalg.norm(value[own]))
            along = value[own] / size if size else np.full(len(own), len(own) ** -0.5)
            found[name] = size, float(np.linalg.norm(along * deviation[own]))
        return found

    def __str__(self) -> str:
        return text_or_repr(self, self._text)

    def _text(self) -> str:
        told = [
            f"{name} {100 * size:.1f} +- {100 * std:.1f} %"
            for name, (size, std) in self.sizes.items()
            if size > TOLD * std
        ]
        return ", ".join(told) or "in no pattern alone"


def no_form(dtype: DTypeLike) -> Form:
    """Of a shape without a wall about an axis, or of which nothing is said."""
    blank = jnp.zeros(len(DEPARTURES), dtype)
    return Form(blank, blank, jnp.zeros((), dtype))


class Departures(NamedTuple):
    """What readings say of a wall's form, if each errs by itself.

    Attributes:
        value: As of `Form`.
        covariance: Of these.
        chi2: As of `Form`.
        shared: What the free coordinates have in common with each, in coordinates in
            which independent errors have a variance of 1.
        residual: What a wall that departs so leaves of the readings' residuals.
    """

    value: Float[Array, "6"]
    covariance: Float[Array, "6 6"]
    chi2: Float[Array, ""]
    shared: Float[Array, "6 c"]
    residual: Float[Array, " n"]

    def told(self, repeats: Float[Array, ""]) -> tuple[Form, Float[Array, "c c"]]:
        """The form, and the covariance of the free coordinates that is due to it.

        It is in the coordinates of `shared`, and 0 where the noise explains all.

        Args:
            repeats: How many readings share an error.
        """
        own = self.covariance * repeats
        form = Form(self.value, jnp.sqrt(jnp.diagonal(own)), self.chi2 / repeats)
        doubt = own + self.value[:, None] * self.value[None]
        spread = product(self.shared.T, product(doubt, self.shared))
        return form, jnp.where(form.departs, spread, 0)


def departures_of(
    augmented: Float[Array, "k n"],
    swelling: Float[Array, " n"],
    counts: Bool[Array, " n"],
    into: Float[Array, "c t"],
    root: Float[Array, "c c"],
    pull: Float[Array, " c"],
    variance: Float[Array, ""],
) -> Departures:
    """Test whether readings of a wall about an axis depart from it in a pattern.

    The six patterns are coordinates more, whose step from 0 is that of Gauss and
    Newton. Had they been free, the others would have moved by what they share of it.

    Args:
        augmented: Gradient in tangent coordinates and residual of each reading, as of
            `Terms`. The first four of these tilt and move the wall across its axis.
        swelling: Derivative of the residuals in the logarithm of the wall's radius.
        counts: Readings of the wall.
        into: Tangent coordinates that each free coordinate moves, one a row.
        root: Of the covariance of the free coordinates, as of `covariance_root`.
        pull: Of all terms, on the free coordinates.
        variance: Of the whitened residuals.
    """
    patterns = jnp.where(counts[None], swelling[None] * _outward(augmented, counts), 0)
    told = product(patterns, jnp.concatenate([augmented, patterns]).T) / variance
    num_tangent = into.shape[1]
    shared = product(told[:, :num_tangent], product(into.T, root))
    own = told[:, num_tangent + 1 :] - product(shared, shared.T)
    pulls = told[:, num_tangent] - product(shared, product(root.T, pull))
    one = jnp.eye(len(own), dtype=own.dtype)
    covariance = jax.scipy.linalg.solve(own + one / USUAL**2, one, assume_a="pos")
    value = -product(covariance, pulls)
    moved = -product(into.T, root, product(value, shared))
    change = product(value, patterns) + product(moved, augmented[:-1])
    return Departures(
        value=value,
        covariance=covariance,
        chi2=-jnp.sum(value * pulls),
        shared=shared,
        residual=augmented[-1] + change,
    )


def _outward(
    gradient: Float[Array, "k n"], counts: Bool[Array, " n"]
) -> Float[Array, "6 n"]:
    """How far each pattern moves the wall outward at each reading."""
    tilted, moved = gradient[0:2], gradient[2:4]
    square = jnp.sum(moved**2, axis=0)
    is_wall = counts & (square > 0)
    cos, sin = moved * jax.lax.rsqrt(jnp.where(square > 0, square, 1))[None]
    along = safe_divide(jnp.sum(tilted * moved, axis=0), square)
    ones = jnp.where(is_wall, 1, 0).astype(along.dtype)
    away = (along - safe_divide(jnp.sum(along * ones), jnp.sum(ones))) * ones
    farthest = jnp.full_like(away, jnp.max(jnp.abs(away)))
    place = safe_divide(away, farthest)
    ends = place**2
    # The sign of a direction, which derivatives leave open, turns the bend alone.
    patterns = [place, ends, cos**2 - sin**2, 2 * cos * sin, ends * cos, ends * sin]
    return jnp.where(is_wall[None], jnp.stack(patterns), 0)
