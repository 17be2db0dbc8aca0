"""The tables of the README from results.json, and the figure."""

__all__ = ["draw", "tables"]

from pathlib import Path

from matplotlib.figure import Figure

from experiments.mask_errors.scenes import MASKS
from experiments.recording import read_spreads, read_values, three_digits
from impostor_jax.io.atomic import write_atomically

GROUPS = ("table", "small", "lying", "wall")

Values = dict[str, float | None]


def tables(folder: Path) -> str:
    """Results of a folder in Markdown."""
    values = read_values(folder)
    lines = []
    for noise in _noises(values):
        head = (
            f"| mask, {noise} | intervals that hold | table | small | lying | wall "
            "| largest: table | small | lying | wall | beyond 5 | failed | ms |"
        )
        lines += ["", head, "|---|" + "--:|" * 12]
        for mask in MASKS:
            label = f"{noise}.{mask}"
            if f"{label}.all.failures" not in values:
                continue
            cells = [
                _percent(values.get(f"{label}.{group}.coverage_95"))
                for group in ("all", *GROUPS)
            ]
            cells += [
                three_digits(values.get(f"{label}.{group}.largest")) for group in GROUPS
            ]
            cells += [
                str(values[f"{label}.all.far"]),
                _failures(values, f"{label}.all"),
                three_digits(values[f"{label}.all.time"]),
            ]
            lines.append(f"| {mask} | {' | '.join(cells)} |")
    lines += [
        "",
        "| preset | fits | intervals that hold | largest | beyond 5 | wrong | failed "
        "| ms |",
        "|---|" + "--:|" * 7,
    ]
    spreads = read_spreads(folder)
    for label in _cases(values, "preset"):
        part, spread = spreads[f"{label}.coverage_95"]
        number = values[f"{label}.number"]
        assert part is not None
        assert spread is not None
        cells = [
            str(number),
            f"{_percent(part)} ({_percent(spread)})",
            three_digits(values[f"{label}.largest"]),
            str(values[f"{label}.far"]),
            str(values[f"{label}.wrong"]),
            _failures(values, label),
            three_digits(values[f"{label}.time"]),
        ]
        lines.append(f"| {label.split('.')[1]} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _cases(values: Values, kind: str) -> list[str]:
    return [
        name.removesuffix(".failures")
        for name in values
        if name.startswith(f"{kind}.") and name.endswith(".failures")
    ]


def _noises(values: Values) -> list[str]:
    """What the first part of a can's metrics says."""
    return list(
        dict.fromkeys(
            name.split(".")[0] for name in values if not name.startswith("preset.")
        )
    )


def _percent(part: float | None) -> str:
    return "" if part is None else f"{part:.1%}"


def _failures(values: Values, label: str) -> str:
    """The number, and of which status."""
    start = f"{label}.status."
    parts = [
        f"{number} {name.removeprefix(start)}"
        for name, number in values.items()
        if name.startswith(start)
    ]
    return ", ".join(parts) or "0"


def draw(folder: Path) -> None:
    """Coverage and largest error against what is wrong with the mask."""
    values = read_values(folder)
    figure = Figure(figsize=(10, 6), layout="constrained")
    grid = figure.subplots(2, 2, sharex=True, squeeze=False)
    for column, noise in enumerate(_noises(values)):
        for row, quantity in enumerate(("coverage_95", "largest")):
            axes = grid[row, column]
            for group in GROUPS:
                found = [
                    values.get(f"{noise}.{mask}.{group}.{quantity}") for mask in MASKS
                ]
                # What was not measured is left out of the line.
                axes.plot(
                    list(MASKS),
                    [float("nan") if value is None else value for value in found],
                    "o-",
                    markersize=4,
                    label=group,
                )
            axes.grid(alpha=0.3)
        grid[0, column].set_title(f"noise {noise}")
        grid[0, column].axhline(0.95, color="black", linewidth=0.8)
        grid[0, column].set_ylim(0, 1.02)
        grid[1, column].set_ylim(bottom=0)
        grid[1, column].tick_params("x", rotation=45)
    grid[0, 0].set_ylabel("95 % intervals that hold")
    grid[1, 0].set_ylabel("largest error in deviations")
    grid[0, 0].legend()
    write_atomically(
        folder / "figures" / "mask_errors.png",
        lambda temporary: figure.savefig(temporary, dpi=90, format="png"),
    )
