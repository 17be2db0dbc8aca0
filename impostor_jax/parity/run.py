"""The matrix of cases, drawn by JAX and by a driver and compared pixel by pixel."""

__all__ = ["RENDERERS", "Row", "drawn_by_jax", "open_renderer", "run_parity"]

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from impostor_jax.arguments import one_of
from impostor_jax.camera.base import AbstractCamera
from impostor_jax.effort import Effort
from impostor_jax.glsl.conventions import DrawnMaps
from impostor_jax.glsl.offscreen import DRIVERS, OffscreenRenderer
from impostor_jax.glsl.webgl import WebglRenderer
from impostor_jax.parity.case import Case, Primitives
from impostor_jax.parity.compare import Comparison, Spread, compare, rounding
from impostor_jax.parity.condition import condition_of
from impostor_jax.parity.judge import Verdict, judge
from impostor_jax.parity.traced import TracedCase, TracedRow, compare_traced
from impostor_jax.rendering.render import render
from impostor_jax.rendering.scene import Scene

RENDERERS = (*DRIVERS, "webgl")

COMPARED = ("depth", "point", "normal", "mask", "index", "part")
"""Maps that both sides have."""


@dataclasses.dataclass(frozen=True)
class Row:
    """A case, what was measured, and whether it is within the bounds.

    Attributes:
        case: The case.
        found: The differences.
        depth: Those of depth, in eps times the condition number.
        normal: Those of the normal.
        verdicts: Each quantity beside its bound.
        reference: What JAX drew.
        drawn: What the driver drew.
    """

    case: Case
    found: Comparison
    depth: Spread
    normal: Spread
    verdicts: list[Verdict]
    reference: DrawnMaps
    drawn: DrawnMaps

    @property
    def holds(self) -> bool:
        """Whether every quantity is within its bound."""
        return all(verdict.holds for verdict in self.verdicts)


def drawn_by_jax(
    primitives: Primitives,
    camera: AbstractCamera,
    precision: Literal["float32", "float64"] | None = None,
) -> DrawnMaps:
    """What `render` makes of the primitives that a driver draws.

    Args:
        primitives: As `OffscreenRenderer.draw` takes them.
        camera: As `OffscreenRenderer.draw` takes it.
        precision: Of all numbers; JAX's own if None.
    """
    several = primitives if isinstance(primitives, Sequence) else (primitives,)
    one = several[0] if len(several) == 1 and not several[0].batch_shape else None
    seen = Scene(several) if one is None else one
    maps = render(seen, camera, COMPARED, effort=Effort(precision=precision))
    return DrawnMaps(**{name: np.asarray(getattr(maps, name)) for name in COMPARED})


def open_renderer(
    driver: str = "llvmpipe", shaders: Path | None = None
) -> OffscreenRenderer | WebglRenderer:
    """Open what draws; use it in a `with` block.

    Args:
        driver: "llvmpipe", "softpipe", "gpu" or "webgl".
        shaders: Folder whose shaders take the place of those of the same names.
    """
    one_of("driver", driver, RENDERERS)
    if driver == "webgl":
        return WebglRenderer(shaders)
    return OffscreenRenderer(driver, shaders)


def run_parity(
    chosen: Sequence[Case | TracedCase], renderer: OffscreenRenderer | WebglRenderer
) -> Iterator[Row | TracedRow]:
    """Draw cases with JAX and with a driver, and compare them.

    Yields:
        A row for each case as it is done.
    """
    for case in chosen:
        if isinstance(case, TracedCase):
            drawn = renderer.trace(
                case.shapes, case.camera, case.lights, case.materials, case.background
            )
            yield compare_traced(case, drawn)
            continue
        reference = drawn_by_jax(case.primitives, case.camera)
        drawn = renderer.draw(case.primitives, case.camera)
        condition = condition_of(case.primitives, case.camera, reference.index)
        found = compare(reference, drawn)
        depth, normal = rounding(reference, drawn, condition)
        verdicts = judge(found, depth, normal)
        yield Row(case, found, depth, normal, verdicts, reference, drawn)
