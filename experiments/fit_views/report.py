"""The table of the README from results.json."""

__all__ = ["COMPARED", "tables"]

from experiments.columns import Column
from experiments.markdown import table
from experiments.recording import Results

COMPARED = ("radius", "height")
"""Of a can, what is compared."""

COLUMNS = [
    Column("failures", "failures", ""),
    *(
        column
        for name in COMPARED
        for column in (
            Column(f"{name}: error, um", f"{name}.rms", ".1f", 1e6),
            Column("over the bound", f"{name}.over_bound", ".2f"),
            Column("reachable", f"{name}.over_reachable", ".2f"),
            Column("bias", f"{name}.bias", "+.2f"),
            Column("95 % that hold", f"{name}.inside", ".1f", 100),
        )
    ),
]


def tables(results: Results) -> str:
    """Errors, their ratio to the bound, biases and intervals, by views and noise."""
    rows = [
        [*case.split(".")[1:], *(column.cell(results, case) for column in COLUMNS)]
        for case in results.cases("views.", ".failures")
    ]
    return table(["views", "noise", *(column.head for column in COLUMNS)], rows)
