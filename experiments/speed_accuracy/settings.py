"""Settings that are compared: the presets, and each dial turned from the default."""

__all__ = ["FITS", "RENDERS"]

import dataclasses
from typing import Any

from impostor_jax.effort import EFFORTS, Effort

FIT_DIALS: dict[str, tuple[Any, ...]] = {
    "precision": ("float64",),
    "readings": (512, 1024, 2048),
    "starts": (1, 3),
    "all_starts": (True,),
    "tolerance": (0.02, 0.2, 5.0),
    "max_steps": (2, 5),
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

RENDERS = _turned(RENDER_DIALS)
"""Of renders, by name."""
