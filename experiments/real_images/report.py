"""The table of the README from results.json."""

__all__ = ["tables"]

from experiments.markdown import number, table
from experiments.recording import Results

RADII = {"outer_radius": "outer radius, mm", "inner_radius": "inner radius, mm"}
MODELS = {"whole": "whole camera", "noise": "noise of readings alone"}


def tables(results: Results) -> str:
    """Error and interval of each can's radius by each model, and by other programs."""
    values = results.values
    labels = results.cases("", ".error")
    cases = dict.fromkeys(label.rpartition(".")[0] for label in labels)
    peers = dict.fromkeys(
        name for label in labels if (name := label.rpartition(".")[2]) not in MODELS
    )
    rows, budget = [], []
    for case in cases:
        cells = [_interval(results, f"{case}.{model}.error") for model in MODELS]
        others = [number(values.get(f"{case}.{peer}.error"), "+.2f") for peer in peers]
        rows.append([case, *cells, *others])
        start = f"{case}.whole.std."
        parts = {
            name.removeprefix(start): number(value, ".2f")
            for name, value in values.items()
            if name.startswith(start)
        }
        made_of = ", ".join(f"{name} {value}" for name, value in parts.items())
        budget.append([case, made_of])
    head = ["error of the radius, mm", *MODELS.values(), *peers]
    made = ["standard deviation of the radius, whole camera", "is made of, mm"]
    blocks = [table(head, rows), table(made, budget)]
    mugs = [
        [
            case,
            *(_value(results, f"{case}.tube.{name}") for name in RADII),
            number(values[f"{case}.tube.statistic"]),
        ]
        for case in results.cases("", ".tube.statistic")
    ]
    if mugs:
        head = ["with its mouth, whole camera", *RADII.values(), "likelihood ratio"]
        blocks.append(table(head, mugs))
    return "\n\n".join(blocks)


def _value(results: Results, name: str) -> str:
    value, half = results.pair(name)
    return "failed" if value is None else f"{value:.2f} +- {half:.2f}"


def _interval(results: Results, name: str) -> str:
    value, half = results.pair(name)
    return "failed" if value is None else f"{value:+.2f} +- {half:.2f}"
