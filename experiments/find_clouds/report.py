"""The tables of the README from results.json."""

__all__ = ["tables"]

from experiments.columns import Column, case_table
from experiments.recording import Results

SCORES = (
    Column("cylinders", "truths", ".0f"),
    Column("recall", "recall", ".2f"),
    Column("AP coarse", "ap.coarse", ".2f"),
    Column("standard", "ap.standard", ".2f"),
    Column("fine", "ap.fine", ".2f"),
    Column("false a cloud", "false", ".2f"),
    Column("radius, mm", "radius", ".1f"),
    Column("95 % hold", "inside", ".2f"),
    Column("s", "seconds", ".1f"),
)

CALIBRATION = [Column("calibration error", "calibration_error", ".3f")]

TIMES = Column("s", "warm", ".1f"), Column("found", "found", "")


def tables(results: Results) -> str:
    """Precision and recall, errors of radii, and times."""
    parts = (
        ("clouds", ".recall", SCORES),
        ("program", ".calibration_error", CALIBRATION),
        ("warm search", ".warm", TIMES),
    )
    return "\n\n".join(
        case_table(results, head, results.cases("", end), columns)
        for head, end, columns in parts
    )
