"""Comparisons that several tests make."""

import jax
import jax.numpy as jnp
import numpy as np

from experiments.oracle import claims
from impostor_jax.compiling import _Kept

AS_USERS_RUN = claims.AS_USERS_RUN

QUICKLY = {"xla_backend_optimization_level": 0}
"""Options for programs that take longer to compile than to run: XLA's optimizations
are nearly all of that. What is at the extremes, or promised of rounding, takes another
path then, and is not tested with it."""


COUNTED = {
    "xla_disable_hlo_passes": "fusion",
    "xla_backend_optimization_level": 0,
    "xla_llvm_disable_expensive_passes": True,
}
"""Options for a program whose work is counted. Fusion computes anew what several
results share, now more and now less; what makes machine code fast takes time and
counts for nothing."""


def angle_between(first, second) -> float:
    """Angle between two lines, in degrees."""
    first, second = np.asarray(first, float), np.asarray(second, float)
    sine = np.linalg.norm(np.cross(first, second))
    return float(np.degrees(np.arctan2(sine, abs(first @ second))))


def prepared_by(monkeypatch) -> list:
    """Where programs will be noted that are prepared from here on, and not made.

    Each with the key that its parts have it by.
    """
    asked = []
    monkeypatch.setattr(
        _Kept,
        "prepare",
        lambda self, *given: asked.append((self, self._asked(given, {})[2])),
    )
    return asked


def all_finite(tree) -> bool:
    """Whether all numbers of a tree are finite."""
    return all(bool(np.isfinite(leaf).all()) for leaf in jax.tree.leaves(tree))


def central_difference(function, tree, tangent, step=1e-6):
    """Directional derivative of a function by central differences."""
    ahead = function(jax.tree.map(lambda x, t: x + step * t, tree, tangent))
    behind = function(jax.tree.map(lambda x, t: x - step * t, tree, tangent))
    return (np.asarray(ahead) - np.asarray(behind)) / (2 * step)


def in_chunks(function, *fields, size=400):
    """Results of a function of rows, so many at a time: one compilation serves all."""
    count = len(fields[0])
    chunks = []
    for start in range(0, count, size):
        rows = np.arange(start, start + size).clip(max=count - 1)
        found = function(*(jnp.asarray(field[rows]) for field in fields))
        chunks.append(jax.tree.map(np.asarray, found))
    return jax.tree.map(lambda *parts: np.concatenate(parts)[:count], *chunks)


def compiled_cost(function, *arguments, **keywords):
    """Floating-point operations and bytes of memory that a call takes, as XLA counts.

    A loop counts as one pass.
    """
    lowered = jax.jit(function).lower(*arguments, **keywords)
    analysis = lowered.compile(COUNTED).cost_analysis()
    return np.array([analysis["flops"], analysis["bytes accessed"]])
