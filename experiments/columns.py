"""Tables of cases: a row for each case, a column for each of its metrics."""

__all__ = ["Column", "Failures", "case_table", "without_group"]

from collections.abc import Callable, Iterable
from typing import NamedTuple

from experiments.markdown import number, table
from experiments.recording import Results


class Column(NamedTuple):
    """What a table tells of each case.

    Attributes:
        head: What stands above it.
        metric: What the metric's name has behind the case's.
        form: Of the number, or what writes it.
        scale: From the metric's unit to the column's.
        has_spread: Whether the spread stands in brackets behind it.
    """

    head: str
    metric: str
    form: str | Callable[[float | None], str] = ".3g"
    scale: float = 1
    has_spread: bool = False

    def cell(self, results: Results, case: str) -> str:
        """The number of a case; blank where it was not measured."""
        pair = results.pair(f"{case}.{self.metric}")
        value, spread = (None if x is None else self.scale * x for x in pair)
        if callable(self.form):
            return self.form(value)
        return number(value, self.form, spread if self.has_spread else None)


class Failures(NamedTuple):
    """Number of a case's fits that failed, by their status.

    Attributes:
        head: What stands above it.
        start: What the statuses' names have behind the case's.
    """

    head: str = "failed"
    start: str = "status"

    def cell(self, results: Results, case: str) -> str:
        """Numbers and statuses; 0 where none failed."""
        start = f"{case}.{self.start}."
        parts = (
            f"{count} {name.removeprefix(start)}"
            for name, count in results.values.items()
            if name.startswith(start)
        )
        return ", ".join(parts) or "0"


def case_table(
    results: Results,
    head: str,
    cases: Iterable[str],
    columns: Iterable[Column | Failures],
    label: Callable[[str], str] = str,
) -> str:
    """A row for each case.

    Args:
        results: Of the experiment.
        head: Above the labels.
        cases: What the metrics' names begin with.
        columns: What is told of each.
        label: What a reader calls a case.
    """
    columns = tuple(columns)
    rows = (
        [label(case), *(column.cell(results, case) for column in columns)]
        for case in cases
    )
    return table([head, *(column.head for column in columns)], rows)


def without_group(case: str) -> str:
    """What stands behind the first dot of a case's name."""
    return case.split(".", 1)[1]
