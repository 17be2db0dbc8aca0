"""The table of the README from results.json, and the figure."""

__all__ = ["draw", "tables"]

from matplotlib.figure import Figure

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


def draw(results: Results) -> dict[str, Figure]:
    """Mean error of the radius after each change."""
    figure = Figure(figsize=(7, 3), layout="constrained")
    axes = figure.subplots()
    cases = results.cases("", ".success")
    means = [results.values.get(f"{case}.bias") or 0.0 for case in cases]
    spreads = [results.spreads.get(f"{case}.bias") or 0.0 for case in cases]
    axes.barh(range(len(cases)), means, xerr=spreads)
    axes.set_yticks(range(len(cases)), cases)
    axes.invert_yaxis()
    axes.set_xlabel("mean error of the radius in its standard deviations")
    return {"averaged_images": figure}
