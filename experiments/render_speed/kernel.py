"""The same render by `kernel.c`, compiled here and called through ctypes."""

__all__ = ["c_render"]

import ctypes
import functools
import math
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float

import impostor_jax as ij

THREADS = 2

FLAGS = (
    "-O3 -march=native -mprefer-vector-width=512 -ffast-math -fopenmp -shared -fPIC"
).split()


def c_render(
    can: ij.Cylinder,
    camera: ij.PinholeCamera,
    expected: Float[np.ndarray, "h w"],
    scratch: Path,
) -> Callable[[], object] | None:
    """Compile the kernel and bind it to buffers of its own.

    Args:
        can: What is drawn, in the camera frame.
        camera: Without a lens and a pose.
        expected: Depth that the kernel must draw.
        scratch: Folder of the library, which lives as long as the call is used.

    Returns:
        A call that draws depth, normal and mask; None where there is no gcc or it does
        not know the flags, which is printed.

    Raises:
        ValueError: The kernel draws another image.
    """
    library = scratch / "kernel.so"
    source = Path(__file__).with_name("kernel.c")
    try:
        subprocess.run(["gcc", *FLAGS, source, "-o", library, "-lm"], check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        print(f"the kernel in C is left out: {error}")
        return None
    function = ctypes.CDLL(str(library)).render
    function.restype = None
    sizes = [np.asarray(size)[None] for size in (can.radius, can.height)]
    cylinder = np.concatenate([can.center, can.axis, *sizes]).astype(np.float32)
    pinhole = np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32)
    depth = np.zeros(expected.shape, np.float32)
    normal = np.zeros((*expected.shape, 3), np.float32)
    mask = np.zeros(expected.shape, np.uint8)
    # A pointer made by data_as keeps its array alive.
    pointers = [
        array.ctypes.data_as(ctypes.c_void_p)
        for array in (cylinder, pinhole, depth, normal, mask)
    ]
    call = functools.partial(
        function,
        *pointers[:2],
        *(ctypes.c_int(n) for n in (camera.width, camera.height, THREADS)),
        ctypes.c_float(math.inf),
        *pointers[2:],
    )
    call()
    both = (mask > 0) & np.isfinite(expected)
    flips = np.count_nonzero((mask > 0) != np.isfinite(expected))
    difference = np.median(np.abs(depth[both] - expected[both]))
    # Rays along the outline may fall on either side.
    if not difference < 1e-6 or flips > 0.01 * np.count_nonzero(both):
        raise ValueError(
            "C and JAX must draw the same image, got a median difference of "
            f"{difference} meters and {flips} pixels that only one of them hits"
        )
    return call
