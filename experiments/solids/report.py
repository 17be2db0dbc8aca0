"""The tables of the README from results.json."""

__all__ = ["DISTANCES", "tables"]

from experiments.markdown import number, table
from experiments.recording import Results

DISTANCES = (3.0, 100.0, 1000.0)
"""In lengths of the solid."""

SHAPES = {
    "can": "a can",
    "1": "a solid of that can alone",
    "2": "of 2 shapes",
    "5": "of 5",
    "8": "of 8",
}


def tables(results: Results) -> str:
    """What rays see, and what they cost."""
    return f"{_rays(results)}\n\n{_times(results)}"


def _rays(results: Results) -> str:
    rows = []
    for distance in DISTANCES:
        shares = [
            results.values.get(f"rays.{distance:g}.{name}")
            for name in ("hits", "differs", "is_wrong", "is_nan")
        ]
        hits, *others = shares
        rows.append([f"{distance:g}", number(hits, ".1%"), *map(number, others)])
    return table(["distance, lengths", "hits", "differ", "wrong", "NaN"], rows)


def _times(results: Results) -> str:
    rows = []
    for name, label in SHAPES.items():
        row = [label]
        for view in ("small", "close"):
            alone = results.values.get(f"time.{view}.can")
            ms, spread = results.pair(f"time.{view}.{name}")
            times = None if ms is None or alone is None else ms / alone
            row += [number(ms, ".3g", spread), number(times, ".3g")]
        rows.append([*row, number(results.values.get(f"first.{name}"), ".2g")])
    head = ["640x480", "ms, small", "times the can", "ms, close", "times", "first, s"]
    return table(head, rows)
