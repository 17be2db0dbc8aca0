"""The tables of the README from results.json, and the figure."""

__all__ = ["draw", "tables"]

from pathlib import Path

from matplotlib.figure import Figure

from experiments.fit_shapes.scenes import COORDINATES
from experiments.recording import read_spreads, read_values
from impostor_jax.io.atomic import write_atomically

CHI_SQUARED = {5: 0.0039, 50: 0.455, 95: 3.84, 99: 6.63}
"""Percentiles of one degree of freedom, which a can's statistic should have."""


def tables(folder: Path) -> str:
    """Results of a folder in Markdown."""
    values = read_values(folder)
    lines = []
    for kind, names in COORDINATES.items():
        cases = _cases(values, kind)
        if not cases:
            continue
        head = "error over the bound (over what is reachable)"
        lines += ["", f"| {head} | {' | '.join(names)} | failures | ms |"]
        lines += ["|---|" + "--:|" * (len(names) + 2)]
        for case in cases:
            cells = [
                f"{values[f'{case}.{name}.over_bound']:.2f} "
                f"({values[f'{case}.{name}.over_reachable']:.2f})"
                for name in names
            ]
            cells += [f"{values[f'{case}.failures']}", f"{values[f'{case}.time']:.0f}"]
            lines.append(f"| {case} | {' | '.join(cells)} |")
        largest = max(abs(values[f"{c}.{name}.bias"]) for c in cases for name in names)
        lines += ["", f"Largest bias over spread ({kind}): {largest:.2f}."]
    tapers = _tapers(values)
    if tapers:
        lines += ["", "| taper | needed | failures | 5 % | 50 % | 95 % | 99 % |"]
        lines += ["|---|" + "--:|" * 6]
        for taper in tapers:
            cells = [
                f"{values[f'{taper}.needed']:.3f}",
                f"{values[f'{taper}.failures']}",
            ]
            cells += [f"{values[f'{taper}.statistic.p{p}']:.3g}" for p in CHI_SQUARED]
            lines.append(f"| {taper.split('.', 1)[1]} | {' | '.join(cells)} |")
        cells = [f"{value:.3g}" for value in CHI_SQUARED.values()]
        lines.append(f"| chi-squared, 1 degree | 0.010 | | {' | '.join(cells)} |")
    return "\n".join(lines)


def _cases(values: dict[str, float | None], kind: str) -> list[str]:
    return [
        name.removesuffix(".failures")
        for name in values
        if name.startswith(f"{kind}.") and name.endswith(".failures")
    ]


def _tapers(values: dict[str, float | None]) -> list[str]:
    return [name.removesuffix(".needed") for name in values if name.endswith(".needed")]


def draw(folder: Path) -> None:
    """Error over the bound of every coordinate, with the spread."""
    spreads = read_spreads(folder)
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    axes = figure.subplots()
    place, ticks = 0, []
    for kind, names in COORDINATES.items():
        for case in _cases(read_values(folder), kind):
            for index, name in enumerate(names):
                value, spread = spreads[f"{case}.{name}.over_bound"]
                assert value is not None
                assert spread is not None
                axes.errorbar(
                    place + 0.1 * (index - len(names) / 2),
                    value,
                    2 * spread,
                    fmt="o",
                    color=f"C{index}",
                    markersize=4,
                )
            ticks.append((place, case.replace(".", "\n")))
            place += 1
    axes.axhline(1, color="black", linewidth=0.8)
    axes.axhline(1.15, color="gray", linewidth=0.8, linestyle="--")
    axes.set_xticks(*zip(*ticks, strict=True))
    axes.set_ylabel("error over the bound (bars: 2 deviations)")
    axes.set_ylim(0, 1.6)
    write_atomically(
        folder / "figures" / "fit_shapes.png",
        lambda temporary: figure.savefig(temporary, dpi=90, format="png"),
    )
