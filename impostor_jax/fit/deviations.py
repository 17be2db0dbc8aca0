"""How sure a fit is of what a user reads, from how its coordinates change that."""

__all__ = ["are_numbers", "deviations_of", "open_where_unseen"]

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from impostor_jax.fit.body import AbstractBody, Readout
from impostor_jax.fit.budget import ANGLES, BUDGET, Budget, Deviations, Told
from impostor_jax.fit.result import Directions
from impostor_jax.fit.uncertainty import propagated
from impostor_jax.numerics import all_finite, product

MOST_TILT = 0.5
"""Standard deviation of an axis, in radians, up to which a shape is known."""

MOST_ASIDE = 0.5
"""The same of a place, in radii."""

MOST_OF_RADIUS = 1 / 7
"""The same of a radius: of arcs of 4 degrees, whose radius a few crossings of a rim
tell, standard deviations were 14 % of it and more and errors up to five of them; of 10
degrees 11 % and 1.5."""

MAY_BE_OPEN = ("along_axis", "height", "inner_radius", "along_edges", "size")
"""What only the ends, or a bore that may be out of sight, determine; a shape is known
without."""


def deviations_of(
    body: AbstractBody,
    change: Readout,
    root: Float[Array, "n n"],
    shares: dict[str, Float[Array, "n n"]],
    directions: Float[Array, "n n"],
    free: Bool[Array, " n"],
    is_outline: bool = False,
) -> tuple[Deviations, Budget, Float[Array, "m m"], Directions, Bool[Array, ""]]:
    """Standard deviations of a body of the world, and whether they leave it known.

    Args:
        body: The body.
        change: Derivative of its `readout` in the free coordinates.
        root: Of their covariance.
        shares: What that is the sum of, by the names of a budget's parts.
        directions: As `covariance_root` returns them, as columns.
        free: Which of them the image leaves free.
        is_outline: Whether what is believed beforehand alone tells the scale.
    """
    num_free = root.shape[0]
    parts = [part.reshape(-1, num_free) for part in change.values()]
    slopes = jnp.concatenate(parts)
    full, is_observed = propagated(slopes, root, directions, free)
    variance = jnp.where(is_observed, jnp.diagonal(full), jnp.inf)
    std = jnp.sqrt(variance)
    names = np.repeat([*change], [len(part) for part in parts])

    # Correlation may take from a variance, too.
    own = jnp.stack([shares.get(name, jnp.zeros_like(root)) for name in BUDGET])
    squares = jnp.sum(product(slopes[None], own) * slopes[None], axis=2)
    budget = jnp.where(is_observed[None], jnp.sqrt(jnp.maximum(squares, 0)), jnp.inf)
    # Of a scene with another scale all that is seen is known as well; and a wall that
    # departs from its shape is known, if not well.
    of_others = budget[np.array([BUDGET.index("scale"), BUDGET.index("form")])]
    taken = jnp.sum(jnp.where(is_observed[None], of_others**2, 0), axis=0)
    if is_outline:
        # Then a distance is known as well as a radius, which is in proportion to it.
        of_prior = jnp.where(is_observed, budget[BUDGET.index("prior")], 0)
        is_radius = np.array(["radius" in name for name in names])
        taken += jnp.where(is_radius, 0, of_prior**2)
    left = jnp.sqrt(jnp.maximum(variance - taken, 0))
    known = {
        name: jnp.all(
            left[np.flatnonzero(names == name)] < _most_deviation(name, body.radius)
        )
        for name in body.coordinates
    }
    if "inner_radius" in known:
        # A pipe may be seen from inside alone.
        known["outer_radius"] |= known["inner_radius"]
    own = np.concatenate([np.flatnonzero(names == name) for name in body.coordinates])
    full, is_observed = full[np.ix_(own, own)], is_observed[own]
    # Motions of the surface: an angle moves the ends by half the size.
    size = body.size
    lengths = jnp.where(np.isin(names[own], ANGLES), size, 1)
    surface = full * (lengths[:, None] * lengths[None])
    # What is free stands apart from the rest and comes first: no variance of that is
    # more than their sum. A larger number would round the others away.
    apart = jnp.where(is_observed, 0, 2 * jnp.trace(surface))
    values, vectors = jnp.linalg.eigh(surface + jnp.diag(apart))
    deviation = jnp.sqrt(jnp.maximum(values[::-1], 0))
    is_free = np.arange(len(own)) < jnp.sum(~is_observed)
    observed = Directions(
        coordinates=is_observed,
        vector=vectors.T[::-1],
        deviation=jnp.where(is_free | (deviation > 500 * size), jnp.inf, deviation),
    )
    public = jnp.where(np.eye(len(own), dtype=bool), variance[own][:, None], full)
    needed = [is_known for name, is_known in known.items() if name not in MAY_BE_OPEN]
    determined = jnp.stack(needed).all()
    told = tuple(names.tolist())
    return Deviations(std, told), Budget(budget, told), public, observed, determined


def open_where_unseen(
    told: Told, body: AbstractBody, ends_seen: Bool[Array, " e"]
) -> Told:
    """Deviations, or a budget, without those of radii at ends that nobody saw.

    A cone's wall is known where it was last seen, and the covariance is of that. What
    is held, whose deviation is 0, stays.
    """
    names = np.array(told.names)
    unseen = jnp.zeros(len(names), bool)
    for name, is_seen in zip(body.of_ends, ends_seen, strict=False):
        unseen |= (names == name) & ~is_seen

    def opened(values: Float[Array, "*batch n"]) -> Float[Array, "*batch n"]:
        is_open = jnp.broadcast_to(unseen, values.shape) & (values > 0)
        return jnp.where(is_open, jnp.inf, values)

    return jax.tree.map(opened, told)


def are_numbers(body: AbstractBody, *told: PyTree) -> Bool[Array, ""]:
    """Whether a body is finite, and nothing told of it NaN or minus infinity.

    Infinite is what is not determined, and readings at the border that lie elsewhere.
    """
    known = [jnp.all(x > -jnp.inf) for x in jax.tree.leaves(told)]
    return jnp.stack([all_finite(body), *known]).all()


def _most_deviation(name: str, radius: Float[Array, ""]) -> float | Float[Array, ""]:
    """Standard deviation up to which something is known."""
    if name in ANGLES:
        return MOST_TILT
    return radius * (MOST_OF_RADIUS if "radius" in name else MOST_ASIDE)
