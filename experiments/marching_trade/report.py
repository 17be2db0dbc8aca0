"""The tables of the README from results.json, and the figure."""

__all__ = ["draw", "tables"]

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.columns import Column, case_table
from experiments.markdown import percent, table
from experiments.recording import Results

Values = dict[str, float | None]


def _meters(value: float | None) -> str:
    return "" if value is None else f"{value:.2g} m"


LABELS = {
    "published.fixed": "0.2, 64 steps, stop at 0.02 m (published)",
    "published.proportional": "0.2, 64 steps, stop at 0.001 t (published)",
    "published.secant": "the same and secant (published)",
    "patient.fixed": "1024 steps, stop at 0.02 m",
    "patient.fixed_secant": "the same and secant",
    "patient.proportional": "1024 steps, stop at 0.001 t",
    "patient.secant": "the same and secant",
    "safe.slope": "safe, bound of the slope",
    "safe.curvature": "safe, bound of the curvature too",
    "safe.grid": "safe, bicubic grid of 513 x 513",
}
COLUMNS = (
    Column("lost", "lost", percent),
    Column("astray", "astray", percent),
    Column("error 50 %", "error.p50", _meters),
    Column("99 %", "error.p99", _meters),
    Column("us a ray", "time"),
)


def tables(results: Results) -> str:
    """Settings on each terrain, and what was checked."""
    blocks = []
    for name in ("smooth", "steep"):
        labels = {f"{name}.{key}": label for key, label in LABELS.items()}
        for key in results.cases(f"{name}.march", ".lost"):
            factor, steps = key.rsplit(".march.", 1)[1].split("_")
            labels[key] = f"{factor}, {steps} steps, stop at 0.02 m"
        cases = [key for key in labels if f"{key}.lost" in results.values]
        blocks.append(case_table(results, name, cases, COLUMNS, labels.__getitem__))
    checks = []
    for key, value in results.values.items():
        if key.split(".")[0] in ("safe", "derivative") or ".normal." in key:
            checks.append([key, f"{value:.6g}"])
        elif ".reference." in key:
            checks.append([key, f"{value:.2g}"])
    return "\n\n".join([*blocks, table(["check", "found"], checks)])


def draw(results: Results) -> dict[str, Figure]:
    """Missed surface and depth error against time, for both terrains."""
    values = results.values
    figure = Figure(figsize=(10, 7), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey="row")
    for column, name in zip(axes.T, ("smooth", "steep"), strict=True):
        for row, quantity in zip(column, ("missed", "error.p50"), strict=True):
            _curves(row, values, name, quantity)
        column[0].set_title(name)
        column[1].set_xlabel("time, microseconds a ray")
    axes[0, 0].set_ylabel("surface missed, part of the rays that hit")
    axes[1, 0].set_ylabel("median depth error of the others, m")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=8, ncols=4, loc="outside lower center")
    return {"marching_trade": figure}


def _curves(axes: Axes, values: Values, name: str, quantity: str) -> None:
    def at(key: str) -> tuple[float, float] | None:
        time = values.get(f"{name}.{key}.time")
        if quantity == "missed":
            lost, astray = (values.get(f"{name}.{key}.{k}") for k in ("lost", "astray"))
            value = None if lost is None or astray is None else lost + astray
        else:
            value = values.get(f"{name}.{key}.{quantity}")
        return None if time is None or value is None else (time, value)

    for factor in ("0.1", "0.2", "0.4", "0.8"):
        points = [at(f"march.{factor}_{steps}") for steps in (16, 64, 256, 1024)]
        points = [point for point in points if point is not None]
        if points:
            axes.plot(*zip(*points, strict=True), "o-", ms=3, label=f"factor {factor}")
    marks = {
        "published.fixed": ("o", "published: 0.2, 64 steps, 0.02 m"),
        "published.secant": ("D", "published: 0.2, 64 steps, 0.001 t, secant"),
        "patient.secant": ("^", "the same with 1024 steps"),
        "safe.slope": ("v", LABELS["safe.slope"]),
        "safe.curvature": ("P", LABELS["safe.curvature"]),
        "safe.grid": ("*", LABELS["safe.grid"]),
    }
    for key, (mark, label) in marks.items():
        point = at(key)
        if point is not None:
            axes.plot(*point, mark, ms=8, label=label)
    axes.set_xscale("log")
    if quantity == "missed":
        axes.set_yscale("symlog", linthresh=1e-3)
    else:
        axes.set_yscale("log")
    axes.grid(alpha=0.3)
