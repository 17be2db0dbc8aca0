"""The table of the README from results.json."""

__all__ = ["tables"]

from experiments.markdown import number, table
from experiments.recording import Results

HEAD = (
    *("image", "success", "beyond 5", "mean error of the radius, std"),
    *("at most, std", "std of the radius, %", "heights seen"),
)


def tables(results: Results) -> str:
    """A row a change."""
    values, rows = results.values, []
    for case in results.cases("", ".success"):
        success, wrong, heights = (
            f"{values[f'{case}.{share}']:.2f}"
            for share in ("success", "wrong", "heights")
        )
        most, relative = (values.get(f"{case}.{x}") for x in ("largest", "relative"))
        bias, spread = results.pair(f"{case}.bias")
        rows.append(
            [
                case,
                success,
                wrong,
                number(bias, ".1f", spread),
                number(most, ".1f"),
                number(None if relative is None else 100 * relative, ".3f"),
                heights,
            ]
        )
    return table(HEAD, rows)
