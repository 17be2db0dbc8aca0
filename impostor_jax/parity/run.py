"""The matrix of cases, drawn by JAX and by a driver and compared pixel by pixel."""

__all__ = ["RENDERERS", "Row", "open_renderer", "run_parity"]

import dataclasses
from collections.abc import Iterator, Sequence

from impostor_jax.arguments import one_of
from impostor_jax.glsl.conventions import DrawnMaps
from impostor_jax.glsl.offscreen import DRIVERS, OffscreenRenderer
from impostor_jax.glsl.reference import draw_with_jax
from impostor_jax.glsl.webgl import WebglRenderer
from impostor_jax.parity.bounds import Verdict, judge
from impostor_jax.parity.case import Case
from impostor_jax.parity.compare import Comparison, compare

RENDERERS = (*DRIVERS, "webgl")


@dataclasses.dataclass(frozen=True)
class Row:
    """A case, what was measured, and whether it is within its bounds."""

    case: Case
    found: Comparison
    verdicts: list[Verdict]
    reference: DrawnMaps
    drawn: DrawnMaps

    @property
    def holds(self) -> bool:
        """Whether every quantity is within its bound."""
        return all(verdict.holds for verdict in self.verdicts)


def open_renderer(
    driver: str = "llvmpipe", as_published: bool = False
) -> OffscreenRenderer | WebglRenderer:
    """Open what draws; use it in a `with` block.

    Args:
        driver: "llvmpipe", "softpipe", "gpu" or "webgl".
        as_published: Whether to draw the published formulas.
    """
    one_of("driver", driver, RENDERERS)
    if driver == "webgl":
        return WebglRenderer(as_published)
    return OffscreenRenderer(driver, as_published)


def run_parity(
    chosen: Sequence[Case], renderer: OffscreenRenderer | WebglRenderer, driver: str
) -> Iterator[Row]:
    """Draw cases with JAX and with a driver, and compare them.

    Args:
        chosen: The cases.
        renderer: What draws them.
        driver: Its name, as `open_renderer` takes it.

    Yields:
        A row for each case as it is done.
    """
    for case in chosen:
        reference = draw_with_jax(case.primitives, case.camera)
        drawn = renderer.draw(case.primitives, case.camera)
        found = compare(reference, drawn)
        yield Row(case, found, judge(case, found, driver), reference, drawn)
