"""Fits of images whose truth is known, by `evaluate`, and what many have in common."""

__all__ = ["counted", "coverage", "labeled", "scaled_errors"]

from collections import Counter
from collections.abc import Iterator, Sequence

import jax
import numpy as np
from jaxtyping import Bool, Float

import impostor_jax as ij
from experiments.recording import Metric
from impostor_jax.evaluate import Outcome, interval_coverage, summarize
from impostor_jax.io.dataset_shard import LabeledImage

FAR = 5.0
"""Deviations beyond which a fit that is called a success is counted."""


def labeled(
    depth: Float[np.ndarray, "h w"],
    mask: Bool[np.ndarray, "h w"],
    camera: ij.PinholeCamera,
    can: ij.Cylinder,
    number: int,
) -> LabeledImage:
    """An image of one can."""
    return LabeledImage(
        depth=depth,
        mask=mask[None],
        camera=camera,
        shapes=jax.tree.map(lambda x: x[None], can),
        visible_fraction=np.ones(1),
        key=str(number),
    )


def scaled_errors(
    outcomes: Sequence[Outcome], names: Sequence[str]
) -> list[Float[np.ndarray, " k"]]:
    """Of each fit that succeeded, errors of what it tells in standard deviations."""
    return [
        np.array([o.errors[x] / o.deviations[x] for x in names if x in o.errors])
        for o in outcomes
        if o.success
    ]


def counted(
    label: str, outcomes: Sequence[Outcome], names: Sequence[str]
) -> Iterator[Metric]:
    """Number, statuses, and fits that are far off or wrong.

    Args:
        label: Of the case.
        outcomes: Of its fits.
        names: Coordinates that are compared.
    """
    off, n = scaled_errors(outcomes, names), len(outcomes)
    yield Metric(f"{label}.number", n, None, "fits", "higher", n)
    for status, number in Counter(o.status for o in outcomes if not o.success).items():
        yield Metric(f"{label}.status.{status}", number, None, "fits", "lower", n)
    far = sum(bool(np.max(np.abs(each)) > FAR) for each in off)
    yield Metric(f"{label}.far", far, None, "fits", "lower", len(off))
    wrong = summarize(outcomes).wrong
    yield Metric(f"{label}.wrong", wrong, None, "fits", "lower", len(off))


def coverage(name: str, outcomes: Sequence[Outcome], names: Sequence[str]) -> Metric:
    """Part of the 95 % intervals of some coordinates that hold the truth.

    Its spread is the standard error if all errors were independent.
    """
    scaled = np.concatenate([*scaled_errors(outcomes, names), []])
    part = interval_coverage(scaled)["95 %"] if scaled.size else None
    return Metric.share(name, part, scaled.size)
