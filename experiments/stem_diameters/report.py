"""The tables of the README from results.json."""

__all__ = ["tables"]

from experiments.columns import Column, case_table
from experiments.markdown import three_digits
from experiments.recording import Results
from experiments.stem_diameters.programs import OURS, PEERS, PRACTICE

NAMES = (*OURS, *PRACTICE, *PEERS)


OURS_BESIDE = (
    Column("over bound", "over_bound", ".2f"),
    Column("over reachable", "over_reachable", ".2f"),
    Column("95 % intervals, %", "inside", ".1f", 100),
)


def tables(results: Results) -> str:
    """Errors, biases and failures of all programs; bounds and intervals of ours."""
    cases = results.cases("", ".image.failures")

    def of_all(quantity: str, head: str, scale: float = 1e3) -> str:
        columns = (
            Column(name, f"{name}.{quantity}", three_digits, scale) for name in NAMES
        )
        return case_table(results, head, cases, columns)

    ours = [f"{case}.{name}" for case in cases for name in OURS]
    known = [own for own in ours if f"{own}.inside" in results.values]
    blocks = (
        of_all("rmse", "diameter, root mean square error, mm"),
        of_all("bias", "diameter, mean error, mm"),
        of_all("failures", "failures, %", 100),
        of_all("time", "time, ms", 1),
        case_table(results, "error of ours", known, OURS_BESIDE),
    )
    return "\n\n".join(blocks)
