"""Masks as run lengths, column by column, as COCO's uncompressed form has them."""

__all__ = ["mask_of_rle", "rle_of_mask"]

from typing import Any

import numpy as np
from jaxtyping import Bool


def rle_of_mask(mask: Bool[np.ndarray, "h w"]) -> dict[str, Any]:
    """Run lengths of a mask; the first is of zeros."""
    flat = np.concatenate([[False], mask.ravel(order="F"), [False]])
    change = np.flatnonzero(flat[1:] != flat[:-1])
    ends = np.concatenate([[0], change, [mask.size]])
    counts = np.diff(ends).tolist()
    # The last run is of zeros, and may be empty.
    return {
        "size": list(mask.shape),
        "counts": counts[:-1] if not counts[-1] else counts,
    }


def mask_of_rle(
    record: dict[str, Any], size: tuple[int, int]
) -> Bool[np.ndarray, "h w"]:
    """The mask of run lengths.

    Args:
        record: As `rle_of_mask` makes it.
        size: Rows and columns that it must have.

    Raises:
        ValueError: It has another size, or its runs do not fill it.
    """
    if list(record["size"]) != list(size):
        raise ValueError(f"size of a mask must be {list(size)}, got {record['size']}")
    counts = np.asarray(record["counts"])
    is_whole = counts.ndim == 1 and np.issubdtype(counts.dtype, np.integer)
    count = size[0] * size[1]
    # Each is checked, since the sum of large ones may overflow.
    fits = is_whole and ((counts >= 0) & (counts <= count)).all()
    if not fits or counts.sum() != count:
        raise ValueError(f"counts of a mask must be runs of {count} pixels")
    values = np.arange(len(counts)) % 2 == 1
    return np.repeat(values, counts).reshape(size, order="F")
