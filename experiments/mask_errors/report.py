"""The tables of the README from results.json, and the figure."""

__all__ = ["draw", "tables"]

from collections.abc import Iterator

from matplotlib.figure import Figure

from experiments.markdown import number, table, three_digits
from experiments.mask_errors.scenes import MASKS
from experiments.recording import Results

GROUPS = ("table", "small", "lying", "wall")


def tables(results: Results) -> str:
    """Cans with each mask, by their noise, and the presets."""
    largest = ["largest: table", *GROUPS[1:]]
    ends = ["beyond 5", "failed", "ms"]
    blocks = []
    for noise in _noises(results):
        head = [f"mask, {noise}", "intervals that hold", *GROUPS, *largest, *ends]
        blocks.append(table(head, _rows(results, noise)))
    values, rows = results.values, []
    for label in results.cases("preset.", ".failures"):
        part, spread = results.pair(f"{label}.coverage_95")
        rows.append(
            [
                label.split(".")[1],
                str(values[f"{label}.number"]),
                number(part, ".1%", spread),
                three_digits(values[f"{label}.largest"]),
                str(values[f"{label}.far"]),
                str(values[f"{label}.wrong"]),
                _failures(results, label),
                three_digits(values[f"{label}.time"]),
            ]
        )
    head = ["preset", "fits", "intervals that hold", "largest", "beyond 5", "wrong"]
    return "\n\n".join([*blocks, table([*head, "failed", "ms"], rows)])


def _rows(results: Results, noise: str) -> Iterator[list[str]]:
    values = results.values
    for mask in MASKS:
        label = f"{noise}.{mask}"
        if f"{label}.all.failures" not in values:
            continue
        held = (values.get(f"{label}.{g}.coverage_95") for g in ("all", *GROUPS))
        largest = (values.get(f"{label}.{group}.largest") for group in GROUPS)
        yield [
            mask,
            *(number(part, ".1%") for part in held),
            *map(three_digits, largest),
            str(values[f"{label}.all.far"]),
            _failures(results, f"{label}.all"),
            three_digits(values[f"{label}.all.time"]),
        ]


def _noises(results: Results) -> list[str]:
    """What the first part of a can's metrics says."""
    firsts = dict.fromkeys(name.split(".")[0] for name in results.values)
    return [first for first in firsts if first != "preset"]


def _failures(results: Results, label: str) -> str:
    """The number, and of which status."""
    start = f"{label}.status."
    parts = [
        f"{number} {name.removeprefix(start)}"
        for name, number in results.values.items()
        if name.startswith(start)
    ]
    return ", ".join(parts) or "0"


def draw(results: Results) -> dict[str, Figure]:
    """Coverage and largest error against what is wrong with the mask."""
    values = results.values
    figure = Figure(figsize=(10, 6), layout="constrained")
    grid = figure.subplots(2, 2, sharex=True, squeeze=False)
    for column, noise in enumerate(_noises(results)):
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
    return {"mask_errors": figure}
