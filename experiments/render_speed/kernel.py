"""The functions of `kernel.c`, compiled here and called through ctypes."""

__all__ = ["Kernel", "compile_kernel"]

import ctypes
import math
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

import impostor_jax as ij
from experiments.render_speed.cases import rows_of
from experiments.render_speed.drawing import Drawing

THREADS = 2

FLAGS = "-O3 -march=native -mprefer-vector-width=512 -ffast-math -fopenmp -fPIC".split()


class Kernel:
    """Calls of the kernel, each bound to buffers that it keeps.

    Args:
        library: The compiled kernel.
    """

    def __init__(self, library: ctypes.CDLL):
        self._library = library

    def frame(
        self, can: ij.Cylinder, camera: ij.PinholeCamera, planes: bool
    ) -> Drawing:
        """Depth, normal and mask; normals as (3, h, w) planes or (h, w, 3) vectors."""
        shape = camera.height, camera.width
        depth, mask = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)
        normal = np.zeros((3, *shape) if planes else (*shape, 3), np.float32)
        call = _bound(
            self._library.frame,
            rows_of(can).astype(np.float32),
            *_view(camera),
            planes,
            *(depth, normal, mask),
        )
        return _drawing(call, depth)

    def scene(self, cylinders: ij.Cylinder, camera: ij.PinholeCamera) -> Drawing:
        """Depth, index, normal planes and mask of the closest of a batch."""
        shape, rows = (camera.height, camera.width), rows_of(cylinders)
        depth, index = np.zeros(shape, np.float32), np.zeros(shape, np.int32)
        normal, mask = np.zeros((3, *shape), np.float32), np.zeros(shape, np.uint8)
        call = _bound(
            self._library.scene,
            rows.astype(np.float32),
            len(rows),
            *_view(camera),
            np.zeros((len(rows), 4), np.int32),
            *(depth, index, normal, mask),
        )
        return _drawing(call, depth)

    def loss(
        self,
        can: ij.Cylinder,
        camera: ij.PinholeCamera,
        target: Float[np.ndarray, "h w"],
    ) -> Callable[[], Float[np.ndarray, "9"]]:
        """Loss and derivatives in center, axis, radius and height, on all pixels."""
        found = np.zeros(9)
        call = _bound(
            self._library.loss,
            rows_of(can).astype(np.float32),
            *_view(camera),
            target.astype(np.float32),
            found,
        )

        def value_and_gradient() -> Float[np.ndarray, "9"]:
            call()
            return found

        return value_and_gradient


def compile_kernel(scratch: Path) -> Kernel | None:
    """Compile the kernel into a folder, which lives as long as the kernel is used.

    Returns:
        None where there is no gcc or it does not know the flags, which is printed.
    """
    part, library = scratch / "kernel.o", scratch / "kernel.so"
    source = Path(__file__).with_name("kernel.c")
    # Linked without -ffast-math: with it a library that is loaded takes subnormal
    # numbers for 0 in all of the process.
    link = ["-shared", "-fopenmp", part, "-o", library, "-lm"]
    try:
        subprocess.run(["gcc", *FLAGS, "-c", source, "-o", part], check=True)
        subprocess.run(["gcc", *link], check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        print(f"the kernel in C is left out: {error}")
        return None
    return Kernel(ctypes.CDLL(str(library)))


def _view(camera: ij.PinholeCamera) -> tuple[Any, ...]:
    """Arguments that all functions take: the camera, the threads, a miss's depth."""
    pinhole = np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32)
    return pinhole, camera.width, camera.height, THREADS, math.inf


def _bound(function: Any, *arguments: Any) -> Callable[[], None]:
    """The call of a function; it keeps the arrays among its arguments alive."""
    function.restype = None
    converted = [_converted(argument) for argument in arguments]
    return lambda: function(*converted)


def _converted(argument: Any) -> Any:
    """An argument in C's words; a pointer made by data_as holds its array."""
    if isinstance(argument, np.ndarray):
        return argument.ctypes.data_as(ctypes.c_void_p)
    if isinstance(argument, float):
        return ctypes.c_float(argument)
    return ctypes.c_int(argument)


def _drawing(call: Callable[[], None], depth: Float[np.ndarray, "h w"]) -> Drawing:
    """A call, and the buffer that it fills with depth."""

    def drawn() -> Float[np.ndarray, "h w"]:
        call()
        return depth

    return Drawing(call, drawn)
