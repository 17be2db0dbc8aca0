"""Poses in text files: rows of numbers and matrices.

All is in double precision, before it is rounded to JAX's.
"""

__all__ = [
    "Matrix",
    "bop_pose",
    "checked_pose",
    "inverse_pose",
    "read_log",
    "read_rows",
    "rigid",
    "text_lines",
]

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from impostor_jax.io.input_file import opened
from impostor_jax.io.points_text import number_rows

Matrix = Float[np.ndarray, "4 4"]


def text_lines(path: Path, what: str) -> list[str]:
    """Lines of a text file but empty ones and comments, which begin with #."""
    with opened(path, what) as file:
        text = file.read().decode("utf-8-sig", "replace")
    lines = (line.strip() for line in text.splitlines())
    return [line for line in lines if line and not line.startswith("#")]


def read_rows(path: Path, count: int) -> Float[np.ndarray, "n k"]:
    """A text file's rows of numbers, of which there is one at least."""
    what = f"file {str(path)!r}"
    rows = number_rows(text_lines(path, what), range(count), None, what)
    if not len(rows):
        raise ValueError(f"{what} must hold rows of {count} numbers, got none")
    return rows


def checked_pose(matrix: Float[np.ndarray, "n m"], what: str) -> Matrix:
    """A matrix that is a pose to within 1e-3.

    Raises:
        ValueError: It is none.
    """
    is_pose = matrix.shape == (4, 4) and bool(np.isfinite(matrix).all())
    if is_pose:
        turn = matrix[:3, :3]
        is_turn = np.allclose(turn @ turn.T, np.eye(3), atol=1e-3)
        is_pose = is_turn and np.allclose(matrix[3], [0, 0, 0, 1], atol=1e-6)
    if not is_pose:
        raise ValueError(f"{what} must hold poses, got {matrix.tolist()}")
    return matrix


def rigid(turn: Float[np.ndarray, "3 3"], shift: Float[np.ndarray, "3"]) -> Matrix:
    """Homogeneous matrix of a rotation and a translation."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, shift
    return matrix


def bop_pose(record: Mapping[str, Any]) -> Matrix:
    """Camera from the world as BOP tells it, whose translation is in millimeters."""
    turn = np.array(record["cam_R_w2c"], float).reshape(3, 3)
    return rigid(turn, 1e-3 * np.array(record["cam_t_w2c"], float).reshape(3))


def inverse_pose(matrix: Matrix) -> Matrix:
    """From the other frame to this one."""
    back = matrix[:3, :3].T
    return rigid(back, -back @ matrix[:3, 3])


def read_log(path: Path) -> list[Matrix]:
    """World from camera of each frame: a line of three numbers, four of a matrix."""
    what = f"trajectory {str(path)!r}"
    lines = text_lines(path, what)
    if len(lines) % 5:
        raise ValueError(f"{what} is cut off: each pose has five lines")
    matrices = [line for k, line in enumerate(lines) if k % 5]
    rows = number_rows(matrices, range(4), None, what)
    return [checked_pose(pose, what) for pose in rows.reshape(-1, 4, 4)]
