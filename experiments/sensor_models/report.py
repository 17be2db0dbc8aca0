"""The table of the README from results.json."""

__all__ = ["tables"]

from experiments.markdown import number, table
from experiments.recording import Results

MODELS = {"whole": "whole camera", "noise": "noise alone"}

SHOWN = {
    "all": "intervals that hold",
    "radius": "radius",
    "axis_first": "axis",
    "axis_second": "axis",
    "center_first": "across",
    "center_second": "across",
    "center_along": "along",
    "height": "height",
}
"""Coordinates, and what a reader calls them."""


def tables(results: Results) -> str:
    """Of each camera, fits as its whole model says and as its noise does."""
    values, rows = results.values, []
    for label in results.cases("", ".number"):
        sensor, model = label.split(".")
        shares = (results.pair(f"{label}.coverage_95.{name}") for name in SHOWN)
        start = f"{label}.status."
        ends = [
            f"{value} {name.removeprefix(start)}"
            for name, value in values.items()
            if name.startswith(start)
        ]
        rows.append(
            [
                f"{sensor.replace('_', ' ')}, {MODELS[model]}",
                str(values[f"{label}.number"]),
                *(number(part, ".1%") for part, _ in shares),
                number(values.get(f"{label}.radius.bias"), "+.2f"),
                number(values.get(f"{label}.radius.spread"), ".2f"),
                number(values.get(f"{label}.radius.std"), ".2f"),
                str(values[f"{label}.far"]),
                str(values[f"{label}.wrong"]),
                ", ".join(ends) or "0",
            ]
        )
    head = ["camera, model of the fit", "fits", *SHOWN.values(), "bias of the radius"]
    head += ["its spread, mm", "std, mm", "beyond 5", "wrong", "failed"]
    return table(head, rows)
