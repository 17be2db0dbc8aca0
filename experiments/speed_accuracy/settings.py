"""Settings that are compared: the presets, and each dial turned from the default."""

__all__ = ["FITS", "MANY", "PHOTOGRAPHED", "RENDERS", "TRACES", "Traced"]

import dataclasses
from typing import Any, NamedTuple

from impostor_jax.effort import EFFORTS, Effort

FIT_DIALS: dict[str, tuple[Any, ...]] = {
    "precision": ("float64",),
    "readings": (512, 1024, 2048),
    "starts": (1, 3),
    "all_starts": (True,),
    "tolerance": (0.02, 0.2, 5.0),
    "doubts": (False,),
    "max_steps": (7, 15, 30),
    "kernel": ("pseudo_huber", "cauchy", "squares"),
}

RENDER_DIALS: dict[str, tuple[Any, ...]] = {
    "precision": ("float64",),
    "stride": (2, 3),
    "extent": ("tile",),
    "outline": ("hard",),
    "samples": (2, 4, 8),
}


def _turned(dials: dict[str, tuple[Any, ...]]) -> dict[str, Effort]:
    presets = {name: effort for name, (_, effort) in EFFORTS.items()}
    return presets | {
        f"{dial}={value}": dataclasses.replace(presets["balanced"], **{dial: value})
        for dial, values in dials.items()
        for value in values
    }


FITS = _turned(FIT_DIALS)
"""Of fits, by name."""

PHOTOGRAPHED = (
    *EFFORTS, "readings=1024", "starts=1", "doubts=False", "max_steps=15",
)  # fmt: skip
"""Those that photographs are fitted with, too: each compiles for minutes."""

RENDERS = _turned(RENDER_DIALS)
"""Of renders, by name."""


class Traced(NamedTuple):
    """How a picture is traced.

    Attributes:
        effort: Dials.
        edges: As `ij.trace` takes them.
    """

    effort: Effort
    edges: str = "hard"


TRACES = {
    "balanced": Traced(Effort()),
    "precision=float64": Traced(Effort(precision="float64")),
    "spacing=2": Traced(Effort(spacing=2)),
    "spacing=4": Traced(Effort(spacing=4)),
    "samples=2": Traced(Effort(samples=2)),
    "samples=3": Traced(Effort(samples=3)),
    "samples=4": Traced(Effort(samples=4)),
    "samples=4, adaptive=False": Traced(Effort(samples=4, adaptive=False)),
    "samples=4, spacing=2": Traced(Effort(samples=4, spacing=2)),
    "edges=area": Traced(Effort(), "area"),
    "samples=2, edges=area": Traced(Effort(samples=2), "area"),
}
"""Of traced pictures, by name."""

MANY = Traced(Effort(samples=16, adaptive=False))
"""What they are compared with."""
