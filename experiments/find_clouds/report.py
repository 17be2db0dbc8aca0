"""The tables of the README from results.json."""

__all__ = ["tables"]

from experiments.markdown import number, table
from experiments.recording import Results


def tables(results: Results) -> str:
    """Precision and recall, errors of radii, and times."""
    values, rows = results.values, []
    for case in results.cases("", ".recall"):

        def cell(name: str, form: str = ".2f", case: str = case) -> str:
            return number(values.get(f"{case}.{name}"), form)

        rows.append(
            [
                case,
                cell("truths", ".0f"),
                cell("recall"),
                *(cell(f"ap.{level}") for level in ("coarse", "standard", "fine")),
                cell("false"),
                cell("radius", ".1f"),
                cell("inside"),
                cell("seconds", ".1f"),
            ]
        )
    head = ["clouds", "cylinders", "recall", "AP coarse", "standard", "fine"]
    head += ["false a cloud", "radius, mm", "95 % hold", "s"]
    blocks = [table(head, rows)]
    errors = [
        [case, number(values[f"{case}.calibration_error"], ".3f")]
        for case in results.cases("", ".calibration_error")
    ]
    blocks.append(table(["program", "calibration error"], errors))
    times = [
        [case, number(values[f"{case}.warm"], ".1f"), f"{values[f'{case}.found']}"]
        for case in results.cases("", ".warm")
    ]
    blocks.append(table(["warm search", "s", "found"], times))
    return "\n\n".join(blocks)
