"""The tables of the README from results.json."""

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

OF_POSES = [
    Column("failures", "failures", ""),
    Column("beyond 4 deviations, %", "beyond", ".1f", 100),
    Column("radius: error, um", "radius.rms", ".1f", 1e6),
    Column("center across: error, um", "center_first.rms", ".0f", 1e6),
]


def tables(results: Results) -> str:
    """Errors by views and noise, beside the bound; and where poses err."""
    rows = [
        [*case.split(".")[1:], *_cells(COLUMNS, results, case)]
        for case in results.cases("views.", ".failures")
    ]
    of_views = table(["views", "noise", *(column.head for column in COLUMNS)], rows)
    rows = [
        [*case.split(".", 1)[1].rsplit(".", 1), *_cells(OF_POSES, results, case)]
        for case in results.cases("poses.", ".failures")
    ]
    heads = ["poses err by", "told", *(column.head for column in OF_POSES)]
    return f"{of_views}\n\n{table(heads, rows)}"


def _cells(columns: list[Column], results: Results, case: str) -> list[str]:
    return [column.cell(results, case) for column in columns]
