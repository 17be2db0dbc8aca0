"""The tables of the README from results.json."""

__all__ = ["tables"]

from experiments.columns import Column, case_table, without_group
from experiments.markdown import number, table
from experiments.recording import Results
from impostor_jax.evaluate import LEVELS, by_visibility
from impostor_jax.fit.fittable import CYLINDER

RUNS = {"fit": "visible masks", "eroded": "masks without their edge pixels"}

STAGES = ("drawing", "rendering", "noise", "coding", "writing")

ERRORS = {
    "radius_mm": "radius mm",
    "axis_deg": "axis deg",
    "center_mm": "center mm",
    "height_mm": "height mm",
    "spread": "error over std",
}

FITTED = (
    Column("number", "number", ".0f"),
    Column("failed", "failures", ".0f"),
    Column("wrong", "wrong", ".0f"),
    *(Column(head, key, ".3f") for key, head in ERRORS.items()),
    *(Column(level, f"coverage.{level}", ".1%") for level in LEVELS),
)

BINS = list(by_visibility([]))

COORDINATES = CYLINDER.coordinates


def tables(results: Results) -> str:
    """Rates, what the time goes into, memory, and fits by visibility."""
    values = results.values

    def cells(names: list[str], form: str) -> list[str]:
        pairs = map(results.pair, names)
        return [number(value, form, spread) for value, spread in pairs]

    rates = ["speed.rate", "speed.rate_after_start", "speed.rate_of_coding_alone"]
    over = ["speed.rate_over_coding", "speed.steady_over_coding"]
    memory = (
        f"{values[f'{case}_images']:.0f} MiB for {case.removeprefix('memory.')}"
        for case in results.cases("memory.", "_images")
    )
    blocks = [
        table(
            ["", "whole command", "after start", "coding alone"],
            [
                ["images/s", *cells(rates, ".1f")],
                ["over coding alone", *cells(over, ".2f"), "1"],
            ],
        ),
        table(
            ["", *STAGES],
            [
                ["ms an image", *cells([f"time.{s}" for s in STAGES], ".1f")],
                ["share", *cells([f"share.{s}" for s in STAGES], ".0%")],
            ],
        ),
        f"Largest process: {', '.join(memory)} images.\n"
        f"Killed and resumed with equal bytes: {values['killed.equal']:.0%}.",
    ]
    for name, title in RUNS.items():
        cases = (f"{name}.{row}" for row in [*BINS, "all"])
        seen = [case for case in cases if values[f"{case}.number"]]
        blocks += [
            f"With {title}, {values[f'{name}.time']:.0f} ms a fit:",
            case_table(results, "visible", seen, FITTED, without_group),
        ]
        rows = [
            [
                level,
                *(number(values[f"{name}.{c}.{level}"], ".1%") for c in COORDINATES),
            ]
            for level in LEVELS
        ]
        head = ["interval", *(name.replace("_", " ") for name in COORDINATES)]
        blocks.append(table(head, rows))
    return "\n\n".join(blocks)
