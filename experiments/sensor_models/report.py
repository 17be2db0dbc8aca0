"""The table of the README from results.json."""

__all__ = ["tables"]

from experiments.columns import Column, Failures, case_table
from experiments.recording import Results

MODELS = {"whole": "whole camera", "noise": "noise alone"}

COVERAGES = {
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

COLUMNS = (
    Column("fits", "number", ""),
    *(Column(head, f"coverage_95.{x}", ".1%") for x, head in COVERAGES.items()),
    Column("bias of the radius", "radius.bias", "+.2f"),
    Column("its spread, mm", "radius.spread", ".2f"),
    Column("std, mm", "radius.std", ".2f"),
    Column("beyond 5", "far", ""),
    Column("wrong", "wrong", ""),
    Failures(),
)


def tables(results: Results) -> str:
    """Of each camera, fits as its whole model says and as its noise does."""
    head, cases = "camera, model of the fit", results.cases("", ".number")
    return case_table(results, head, cases, COLUMNS, _label)


def _label(case: str) -> str:
    sensor, model = case.split(".")
    return f"{sensor.replace('_', ' ')}, {MODELS[model]}"
