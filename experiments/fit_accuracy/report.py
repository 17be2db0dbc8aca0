"""The tables of the README from results.json."""

__all__ = ["tables"]

from collections.abc import Iterator

from experiments.markdown import number, table
from experiments.recording import Results
from impostor_jax.fit.fittable import CYLINDER

PROGRAMS = ("impostor_jax", "scipy", "cylfit", "scikit-spatial", "pyransac3d")

GROUPS = (("axis_first", "axis_second"), ("center_first", "center_second"), ("radius",))
"""Coordinates of which the worse is shown."""


def tables(results: Results) -> str:
    """Our cases, other programs, and intervals."""
    values = results.values
    head = ["case", "axis / bound", "center / bound", "radius / bound", "radius, um"]
    head += ["largest bias / spread", "coverage", "failures", "ms"]
    blocks = [table(head, _rows(results))]
    if compared := _compared(results):
        head = ["radius error, um (over the bound)", *compared, "ms"]
        blocks.append(table(head, _comparison(results, compared)))
    head = ["coverage of 95 % intervals", *CYLINDER.coordinates]
    keys = {noise: _intervals(noise) for noise in _noises(results)}
    blocks.append(
        table(
            head,
            (
                [noise, *(f"{values[k]:.3f}" for k in own)]
                for noise, own in keys.items()
            ),
        )
    )
    return "\n\n".join(blocks)


def _rows(results: Results) -> Iterator[list[str]]:
    values = results.values
    for name in _cases(results):
        ratios = [max(values[f"{name}.{c}.over_bound"] for c in g) for g in GROUPS]
        used = [f"{name}.{c}" for group in GROUPS for c in group]
        bias = max(abs(values[f"{c}.bias_over_spread"]) for c in used)
        held = [values[f"{c}.coverage_95"] for c in used]
        yield [
            name,
            *(f"{ratio:.2f}" for ratio in ratios),
            f"{1e6 * values[f'{name}.radius.rmse']:.1f}",
            f"{bias:.2f}",
            f"{min(held):.2f}-{max(held):.2f}",
            f"{values[f'{name}.failures']:.0f}",
            f"{values[f'{name}.time']:.0f}",
        ]


def _comparison(results: Results, compared: list[str]) -> Iterator[list[str]]:
    """The radius error of each program."""
    values = results.values
    for program in PROGRAMS:
        cells = []
        for case in compared:
            name = f"{_prefix(program)}{case}"
            cell, failures = "no fit", values[f"{name}.failures"]
            if (rmse := values.get(f"{name}.radius.rmse")) is not None:
                cell = f"{1e6 * rmse:.3g} ({values[f'{name}.radius.over_bound']:.3g})"
            cells.append(cell + (f", {failures:.0f} fail" if failures else ""))
        time = values[f"{_prefix(program)}{compared[0]}.time"]
        yield [program, *cells, number(time, ".0f")]


def _prefix(program: str) -> str:
    return "" if program == PROGRAMS[0] else f"{program}."


def _intervals(noise: str) -> list[str]:
    return [f"interval.{noise}.{name}.coverage_95" for name in CYLINDER.coordinates]


def _cases(results: Results) -> list[str]:
    """Cases that we fitted."""
    names = results.cases("", ".radius.over_bound")
    return [name for name in names if name.count(".") == 1 and name[0].isdigit()]


def _noises(results: Results) -> list[str]:
    """Noises whose intervals were counted."""
    names = ("white", "correlated")
    return [name for name in names if _intervals(name)[0] in results.values]


def _compared(results: Results) -> list[str]:
    """Cases that other programs fitted, too."""
    return [
        name
        for name in _cases(results)
        if f"{PROGRAMS[1]}.{name}.time" in results.values
    ]
