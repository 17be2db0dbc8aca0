"""What is timed side by side: one can, its loss and gradient, and scenes of many."""

__all__ = ["Calls", "Tools", "can_calls", "scene_calls"]

import dataclasses
from collections.abc import Callable, Mapping

import jax
import numpy as np
from jaxtyping import Array, Float

import impostor_jax as ij
from experiments.render_speed.cases import (
    OUTPUTS,
    make_many,
    make_mixed,
    squared_difference,
)
from experiments.render_speed.drawing import Drawing, check_drawing
from experiments.render_speed.kernel import Kernel
from experiments.render_speed.peers import (
    draw_with_gl,
    draw_with_mitsuba,
    draw_with_numpy,
    draw_with_open3d,
)
from experiments.scenes import make_can
from impostor_jax.glsl.offscreen import OffscreenRenderer

Calls = dict[str, Callable[[], object]]

TILE_SHAPE = (96, 112)
"""Rows and columns of the tile that follows a traced cylinder."""

MOST_APART = 1e-3
"""Relative difference between the gradients of C and JAX, in single precision."""


@dataclasses.dataclass(frozen=True)
class Tools:
    """What draws besides JAX; None where it is missing."""

    kernel: Kernel | None
    renderer: OffscreenRenderer | None


def can_calls(camera: ij.PinholeCamera, tools: Tools, loss: bool) -> Calls:
    """All that draw the can, and on demand its loss and gradient.

    Raises:
        ValueError: Two programs draw different images, or find different gradients.
    """
    can = make_can()
    tile = ij.outline_tile(can, camera)
    drawings = {
        "opengl": tools.renderer and draw_with_gl(tools.renderer, can, camera),
        "mitsuba": draw_with_mitsuba(can, camera),
        "open3d": draw_with_open3d(can, camera),
    }
    if tools.kernel:
        drawings["c_vectors"] = tools.kernel.frame(can, camera, planes=False)
        drawings["c_planes"] = tools.kernel.frame(can, camera, planes=True)
    if loss:
        drawings["numpy"] = draw_with_numpy(can, camera)
    calls: Calls = {
        "frame": lambda: ij.render(can, camera),
        "depth": lambda: ij.render(can, camera, ("depth",)),
        "tile": lambda: ij.render(can, camera, tile=tile),
    }
    calls |= _checked(drawings, np.asarray(ij.render(can, camera).depth))
    return calls | (_loss_calls(can, camera, tile, tools.kernel) if loss else {})


def scene_calls(
    count: int, seed: int, camera: ij.PinholeCamera, tools: Tools, mixed: bool
) -> Calls:
    """All that draw a scene of cylinders, and on demand JAX with a mixed one.

    Raises:
        ValueError: Two programs draw different images.
    """
    many = make_many(count, seed)
    scene = ij.Scene([many])
    drawings = {
        "c": tools.kernel and tools.kernel.scene(many, camera),
        "opengl": tools.renderer and draw_with_gl(tools.renderer, many, camera),
        "mitsuba": draw_with_mitsuba(many, camera),
        "open3d": draw_with_open3d(many, camera),
    }
    calls: Calls = {"scene": lambda: ij.render(scene, camera, OUTPUTS)}
    if mixed:
        others = make_mixed(count, seed)
        calls["mixed"] = lambda: ij.render(others, camera, OUTPUTS)
    expected = np.asarray(ij.render(scene, camera, OUTPUTS).depth)
    return calls | _checked(drawings, expected)


def _checked(
    drawings: Mapping[str, Drawing | None], expected: Float[np.ndarray, "h w"]
) -> Calls:
    """The calls of the drawings that there are."""
    calls: Calls = {}
    for name, drawing in drawings.items():
        if drawing is not None:
            check_drawing(name, drawing, expected)
            calls[name] = drawing.call
    return calls


def _loss_calls(
    can: ij.Cylinder, camera: ij.PinholeCamera, tile: ij.Tile, kernel: Kernel | None
) -> Calls:
    """Squared difference to the depth of a larger can, and its gradient."""
    target = ij.render(make_can(grown=1.02), camera, ("depth",)).depth
    assert target is not None

    def loss(cylinder: ij.Cylinder, tile: ij.Tile) -> Float[Array, ""]:
        depth = ij.render(cylinder, camera, ("depth",), tile).depth
        assert depth is not None
        corner, size = (tile.row, tile.col), (tile.height, tile.width)
        return squared_difference(depth, jax.lax.dynamic_slice(target, corner, size))

    def loss_on_own_tile(cylinder: ij.Cylinder) -> Float[Array, ""]:
        return loss(cylinder, ij.outline_tile(cylinder, camera, shape=TILE_SHAPE))

    on_tile, on_own_tile, on_frame = (
        jax.jit(jax.value_and_grad(function))
        for function in (
            lambda cylinder: loss(cylinder, tile),
            loss_on_own_tile,
            lambda cylinder: loss(cylinder, camera.frame),
        )
    )
    calls: Calls = {
        "loss_tile": lambda: on_tile(can),
        "loss_own_tile": lambda: on_own_tile(can),
        "loss_frame": lambda: on_frame(can),
    }
    if kernel is not None:
        in_c = kernel.loss(can, camera, np.asarray(target))
        for function in (on_tile, on_own_tile, on_frame):
            _check_gradient(can, in_c(), *function(can))
        calls["c_loss"] = in_c
    return calls


def _check_gradient(
    can: ij.Cylinder,
    in_c: Float[np.ndarray, "9"],
    value: Float[Array, ""],
    gradient: ij.Cylinder,
) -> None:
    """Refuse to compare programs that compute different derivatives.

    Raises:
        ValueError: They differ, but for the part along the axis, which has no meaning.
    """
    pairs = {
        "loss": (in_c[0], value),
        "center": (in_c[1:4], gradient.center),
        "axis": (np.cross(can.axis, in_c[4:7]), np.cross(can.axis, gradient.axis)),
        "radius": (in_c[7], gradient.radius),
        "height": (in_c[8], gradient.height),
    }
    for name, (found, expected) in pairs.items():
        apart = np.linalg.norm(np.ravel(found - np.asarray(expected)))
        if not apart < MOST_APART * np.linalg.norm(np.ravel(expected)):
            raise ValueError(
                f"C and JAX must agree in the {name}, got {found} and {expected}"
            )
