"""The tables of the README from results.json."""

__all__ = ["LEVELS", "tables"]

from experiments.columns import Column, case_table
from experiments.markdown import percent
from experiments.recording import Results
from experiments.scene_descent.scenes import PARTS

LEVELS = (0.05, 0.1, 0.15, 0.2)
"""Of the largest error of all parts, in radii, and of directions in radians."""

WAYS = ("start", "depth", "outlines")


HOME = [Column(f"all within {at}", f"within_{at}", percent) for at in LEVELS]

OFF = [Column(part, part.replace(" ", "_"), ".2g") for part in PARTS]


def tables(results: Results) -> str:
    """Starts that come home, and errors of each part."""
    return "\n\n".join(case_table(results, "", WAYS, part) for part in (HOME, OFF))
