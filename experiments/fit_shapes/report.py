"""The tables of the README from results.json."""

__all__ = ["COORDINATES", "tables"]

from experiments.columns import Column
from experiments.markdown import number, table
from experiments.recording import Results

COORDINATES = {
    "sphere": ("center_x", "center_y", "center_z", "radius"),
    "frustum": (
        *("axis_first", "axis_second", "center_first", "center_second"),
        *("radius", "slope"),
    ),
}
"""What is compared: of a frustum the wall, by its radius beside the true center and the
change of that along the axis."""

CHI_SQUARED = {5: 0.0039, 50: 0.455, 95: 3.84, 99: 6.63}
"""Percentiles of one degree of freedom, which a can's statistic should have."""


TESTS = (
    Column("needed", "needed", ".3f"),
    Column("failures", "failures", ""),
    *(Column(f"{p} %", f"statistic.p{p}") for p in CHI_SQUARED),
)


def tables(results: Results) -> str:
    """Errors over the bound by shape, and the test of a taper."""
    blocks = []
    for kind, names in COORDINATES.items():
        cases = results.cases(f"{kind}.", ".failures")
        if cases:
            blocks += [_errors(results, cases, names), _bias(results, kind, cases)]
    if tapers := results.cases("", ".needed"):
        rows = [
            [taper.split(".", 1)[1], *(test.cell(results, taper) for test in TESTS)]
            for taper in tapers
        ]
        truth = map(number, CHI_SQUARED.values())
        rows.append(["chi-squared, 1 degree", "0.010", "", *truth])
        blocks.append(table(["taper", *(test.head for test in TESTS)], rows))
    return "\n\n".join(blocks)


def _errors(results: Results, cases: list[str], names: tuple[str, ...]) -> str:
    ends = Column("failures", "failures", ""), Column("ms", "time", ".0f")
    rows = []
    for case in cases:
        pairs = (
            [
                results.values[f"{case}.{name}.{over}"]
                for over in ("over_bound", "over_reachable")
            ]
            for name in names
        )
        cells = [number(over, ".2f", reachable) for over, reachable in pairs]
        rows.append([case, *cells, *(end.cell(results, case) for end in ends)])
    head = "error over the bound (over what is reachable)"
    return table([head, *names, *(end.head for end in ends)], rows)


def _bias(results: Results, kind: str, cases: list[str]) -> str:
    biases = (
        results.values[f"{case}.{name}.bias"]
        for case in cases
        for name in COORDINATES[kind]
    )
    return f"Largest bias over spread ({kind}): {max(map(abs, biases)):.2f}."
