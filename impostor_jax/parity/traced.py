"""Traced pictures of a scene, compared off the edges of all that its rays meet."""

__all__ = ["TracedCase", "TracedRow", "compare_traced"]

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from impostor_jax.camera.orthographic import OrthographicCamera
from impostor_jax.camera.pinhole import PinholeCamera
from impostor_jax.parity.compare import Spread, edge_band
from impostor_jax.parity.judge import Verdict
from impostor_jax.primitives.base import AbstractPrimitive
from impostor_jax.rendering.lights import AbstractLight
from impostor_jax.rendering.material import Material, stacked
from impostor_jax.rendering.paths import color_of, world_of
from impostor_jax.rendering.scene import Scene

BOUNCES = 3


@dataclasses.dataclass(frozen=True)
class TracedCase:
    """A scene that is traced; the name is "camera/scene".

    Attributes:
        name: Of the case.
        shapes: Single ones, in the camera frame.
        materials: Of each.
        lights: That shine on them.
        background: Color of rays that meet nothing.
        camera: Which is the world.
        color_p999: Bound of the colors' differences at the 99.9th percentile.
        color_worst: And at any pixel off the edges.
    """

    name: str
    shapes: Sequence[AbstractPrimitive]
    materials: Sequence[Material]
    lights: Sequence[AbstractLight]
    background: tuple[float, float, float]
    camera: PinholeCamera | OrthographicCamera
    color_p999: float
    color_worst: float

    @property
    def count(self) -> int:
        """How many primitives there are."""
        return len(self.shapes)


@dataclasses.dataclass(frozen=True)
class TracedRow:
    """A traced case, what was measured, and whether it is within the bounds.

    Attributes:
        case: The case.
        num_hits: Pixels whose rays meet anything.
        num_edges: Pixels on the edges.
        color: Differences of the colors off the edges.
        verdicts: Each quantity beside its bound.
        reference: What JAX traced.
        drawn: What the driver traced.
    """

    case: TracedCase
    num_hits: int
    num_edges: int
    color: Spread
    verdicts: list[Verdict]
    reference: Float[np.ndarray, "h w 3"]
    drawn: Float[np.ndarray, "h w 3"]

    @property
    def holds(self) -> bool:
        """Whether every quantity is within its bound."""
        return all(verdict.holds for verdict in self.verdicts)


def compare_traced(case: TracedCase, drawn: Float[np.ndarray, "h w 3"]) -> TracedRow:
    """Compare a driver's picture with JAX's."""
    reference, trail = _traced_by_jax(case)
    edges = edge_band(trail)
    apart = np.abs(drawn.astype(np.float64) - reference).max(axis=-1)
    color = Spread.of(apart[~edges])
    return TracedRow(
        case,
        num_hits=int(np.count_nonzero(trail)),
        num_edges=int(np.count_nonzero(edges)),
        color=color,
        verdicts=[
            Verdict("color.p999", color.p999, case.color_p999),
            Verdict("color.worst", color.worst, case.color_worst),
        ],
        reference=reference,
        drawn=drawn,
    )


def _traced_by_jax(
    case: TracedCase,
) -> tuple[Float[np.ndarray, "h w 3"], Int[np.ndarray, "h w"]]:
    """The picture, and of each pixel's ray the number of all that it has met."""
    color, trail = _colors_and_trails(
        Scene(case.shapes),
        stacked(case.materials),
        list(case.lights),
        jnp.asarray(case.background),
        case.camera,
    )
    return np.asarray(color), np.asarray(trail)


@jax.jit
def _colors_and_trails(scene, materials, lights, background, camera):
    row, col = camera.frame.pixels()
    ray = jax.tree.map(lambda x: x.reshape(-1), camera.rays(row, col, scene.dtype))
    world = world_of(scene.groups, materials, lights, background)
    color, trail = color_of(world, ray, jnp.ones(row.size, bool), BOUNCES)
    return color.stack().reshape(*row.shape, 3), trail.reshape(row.shape)
