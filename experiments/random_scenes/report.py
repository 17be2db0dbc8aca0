"""The tables of the README, from results.json."""

__all__ = ["tables"]

from experiments.columns import Column, case_table
from experiments.markdown import percent, table, three_digits
from experiments.recording import Results
from impostor_jax.fit.status import FitStatus


def _count(number: float | None) -> str:
    return str(number or 0)


FAILURES = [
    status
    for status in FitStatus
    if status not in (FitStatus.CONVERGED, FitStatus.AMBIGUOUS, FitStatus.CONTRADICTED)
]
"""Statuses of fits that failed, and say so; nothing is stated that readings could
contradict."""

COLUMNS = (
    Column("right", "right", percent),
    Column("wrong", "wrong", ""),
    Column("of these gross", "gross", ""),
    Column("ambiguous", f"status.{FitStatus.AMBIGUOUS}", _count),
    Column("truth told", "told", ""),
    *(Column(str(status), f"status.{status}", _count) for status in FAILURES),
    Column("ms", "time", three_digits),
)


def tables(results: Results) -> str:
    """What became of each kind of scenes, and the fits that are wrong."""
    kinds = results.cases("", ".right")
    blocks = [case_table(results, "scenes", kinds, COLUMNS)]
    wrong = [
        [
            f"{kind}, seed {case.rpartition('.')[2]}",
            three_digits(results.values[case]),
            three_digits(results.values[f"{case}.axis"]),
        ]
        for kind in kinds
        for case in results.cases(f"{kind}.wrong.", ".axis")
    ]
    if wrong:
        blocks.append(table(["wrong", "deviations off", "axis off, degrees"], wrong))
    return "\n\n".join(blocks)
