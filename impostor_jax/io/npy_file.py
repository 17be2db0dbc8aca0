"""NPY files, of which the header is checked before memory is taken for the numbers."""

__all__ = ["check_npy_bytes", "npy_header", "write_npy"]

import io
import math
import warnings
from pathlib import Path

import numpy as np

from impostor_jax.io.atomic import write_atomically
from impostor_jax.io.input_file import bytes_left


def npy_header(file: io.BufferedReader, what: str) -> tuple[tuple[int, ...], np.dtype]:
    """Shape and type of the array in a file that is open at its beginning.

    Raises:
        ValueError: The header is broken, or the numbers would need a pickle.
    """
    try:
        version = np.lib.format.read_magic(file)
        read = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }
        with warnings.catch_warnings():
            # NumPy warns of headers that other versions wrote.
            warnings.simplefilter("ignore")
            shape, _, dtype = read[version](file)
        if dtype.hasobject:
            raise ValueError("objects are not read")
    except Exception as error:
        # NumPy reads the header as Python, of which anything can go wrong.
        raise ValueError(f"{what} is not a readable NPY file") from error
    return shape, dtype


def check_npy_bytes(
    file: io.BufferedReader, shape: tuple[int, ...], dtype: np.dtype, what: str
) -> None:
    """Raise a `ValueError` unless as many bytes follow the header as it promises."""
    num_bytes = math.prod(shape) * dtype.itemsize
    there = bytes_left(file)
    if there != num_bytes:
        raise ValueError(
            f"{what} is not a readable NPY file: it must hold {num_bytes} bytes "
            f"of numbers, got {there}"
        )


def write_npy(path: Path, values: np.ndarray) -> None:
    """Write an NPY file."""
    write_atomically(path, lambda partial: np.save(partial, values))
