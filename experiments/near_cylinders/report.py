"""The table of the README from results.json."""

__all__ = ["tables"]

from experiments.markdown import table
from experiments.recording import Results

HEAD = (
    *("thing", "success", "said to depart", "wrong", "wrong before"),
    *("at most, std", "before, std", "std of the radius, mm"),
)


def tables(results: Results) -> str:
    """A row a thing."""
    values, rows = results.values, []
    for case in results.cases("", ".success"):
        shares = ("success", "departs", "wrong", "wrong_without")
        largest = (values.get(f"{case}.{x}") for x in ("largest", "largest_without"))
        std = values.get(f"{case}.radius_std")
        rows.append(
            [
                case.replace(".", " "),
                *(f"{values[f'{case}.{share}']:.2f}" for share in shares),
                *("" if x is None else f"{x:.1f}" for x in largest),
                "" if std is None else f"{1e3 * std:.2f}",
            ]
        )
    return table(HEAD, rows)
