"""The tables of the README from results.json."""

__all__ = ["LEVELS", "tables"]

from experiments.markdown import number, percent, table
from experiments.recording import Results
from experiments.scene_descent.scenes import PARTS

LEVELS = (0.05, 0.1, 0.15, 0.2)
"""Of the largest error of all parts, in radii, and of directions in radians."""

WAYS = ("start", "depth", "outlines")


def tables(results: Results) -> str:
    """Starts that come home, and errors of each part."""
    home, off = [], []
    for way in WAYS:
        shares = (percent(results.values.get(f"{way}.within_{at}")) for at in LEVELS)
        home.append([way, *shares])
        parts = (results.values.get(f"{way}.{p.replace(' ', '_')}") for p in PARTS)
        off.append([way, *(number(part, ".2g") for part in parts)])
    head = ["", *(f"all within {at}" for at in LEVELS)]
    return f"{table(head, home)}\n\n{table(['', *PARTS], off)}"
