"""The tables of the README from results.json."""

__all__ = ["COORDINATES", "tables"]

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


def tables(results: Results) -> str:
    """Errors over the bound by shape, and the test of a taper."""
    values, blocks = results.values, []
    for kind, names in COORDINATES.items():
        cases = results.cases(f"{kind}.", ".failures")
        if not cases:
            continue
        head = ["error over the bound (over what is reachable)", *names]
        rows = []
        for case in cases:
            cells = [
                f"{values[f'{case}.{name}.over_bound']:.2f} "
                f"({values[f'{case}.{name}.over_reachable']:.2f})"
                for name in names
            ]
            ends = f"{values[f'{case}.failures']}", f"{values[f'{case}.time']:.0f}"
            rows.append([case, *cells, *ends])
        largest = max(abs(values[f"{c}.{name}.bias"]) for c in cases for name in names)
        blocks += [
            table([*head, "failures", "ms"], rows),
            f"Largest bias over spread ({kind}): {largest:.2f}.",
        ]
    if tapers := results.cases("", ".needed"):
        rows = [
            [
                taper.split(".", 1)[1],
                f"{values[f'{taper}.needed']:.3f}",
                f"{values[f'{taper}.failures']}",
                *(number(values[f"{taper}.statistic.p{p}"]) for p in CHI_SQUARED),
            ]
            for taper in tapers
        ]
        truth = map(number, CHI_SQUARED.values())
        rows.append(["chi-squared, 1 degree", "0.010", "", *truth])
        head = ["taper", "needed", "failures", *(f"{p} %" for p in CHI_SQUARED)]
        blocks.append(table(head, rows))
    return "\n\n".join(blocks)
