"""Searches of several images or clouds, one after the other."""

__all__ = ["found_in_turn"]

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from tqdm import tqdm


def found_in_turn(
    inputs: Sequence[Path],
    places: Sequence[Path],
    unit: str,
    tell: Callable[[str], None],
    search: Callable[[Path, Path], int],
) -> int:
    """Search inputs with a bar, if there are several; the exit code.

    Args:
        inputs: Files that are searched.
        places: Folder of what is written of each.
        unit: What the bar calls one.
        tell: Prints a line for a reader.
        search: Takes an input and its folder; returns how many were found.
    """
    several = len(inputs) > 1
    bar = tqdm(
        zip(inputs, places, strict=True),
        total=len(inputs),
        unit=unit,
        disable=None if several else True,
        file=sys.stderr,
    )
    counts = []
    try:
        for given, place in bar:
            if several:
                tell(f"{given}:")
            counts.append(search(given, place))
    except KeyboardInterrupt as interrupt:
        rest = "interrupted; --resume finds the rest"
        raise KeyboardInterrupt(rest) from interrupt
    return 0 if any(counts) else 1
