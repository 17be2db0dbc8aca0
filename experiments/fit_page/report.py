"""The tables of the README from results.json."""

__all__ = ["tables"]

from experiments.columns import Column, case_table
from experiments.recording import Results

SIZE = [Column("MB", "size", ".2g", 1e-6)]

DRAWING = (
    Column("s to open", "open", ".2g"),
    Column("ms a frame", "frame", has_spread=True),
    Column("kB of its picture", "picture", ".0f", 1e-3),
)


def tables(results: Results) -> str:
    """Size of each page, and what each window takes."""
    pages, windows = results.cases("", ".size"), results.cases("", ".open")
    sizes = case_table(results, "page", pages, SIZE)
    drawing = case_table(
        results, "page, window", windows, DRAWING, lambda case: case.replace(".", ", ")
    )
    return f"{sizes}\n\n{drawing}"
