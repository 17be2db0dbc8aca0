"""The table of the README from results.json, and the figure."""

__all__ = ["draw", "tables"]

from matplotlib.figure import Figure

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


def draw(results: Results) -> dict[str, Figure]:
    """Shares that are wrong and called a success, with the form's part and without."""
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    axes = figure.subplots()
    cases = results.cases("", ".success")
    for shift, (label, name) in zip(
        (-0.2, 0.2),
        (("wrong_without", "without"), ("wrong", "with the part of its form")),
        strict=True,
    ):
        shares = [results.values[f"{case}.{label}"] for case in cases]
        places = [k + shift for k in range(len(cases))]
        axes.bar(places, shares, width=0.4, label=name)
    axes.set_xticks(range(len(cases)), [case.replace(".", "\n") for case in cases])
    axes.set_ylabel("success, 3 deviations off or more")
    axes.legend(title="deviations")
    return {"near_cylinders": figure}
