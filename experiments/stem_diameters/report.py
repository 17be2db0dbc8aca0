"""The tables of the README from results.json."""

__all__ = ["tables"]

from experiments.markdown import number, table, three_digits
from experiments.recording import Results
from experiments.stem_diameters.programs import OURS, PEERS, PRACTICE

NAMES = (*OURS, *PRACTICE, *PEERS)


def tables(results: Results) -> str:
    """Errors, biases and failures of all programs; bounds and intervals of ours."""
    values = results.values
    cases = results.cases("", ".image.failures")

    def of_all(quantity: str, head: str, scale: float = 1e3) -> str:
        rows = []
        for case in cases:
            found = [values.get(f"{case}.{name}.{quantity}") for name in NAMES]
            scaled = [None if x is None else scale * x for x in found]
            rows.append([case, *map(three_digits, scaled)])
        return table([head, *NAMES], rows)

    rows = []
    for own in (f"{case}.{name}" for case in cases for name in OURS):
        if (inside := values.get(f"{own}.inside")) is not None:
            over, reachable = (
                values.get(f"{own}.{name}") for name in ("over_bound", "over_reachable")
            )
            numbers = number(over, ".2f"), number(reachable, ".2f")
            rows.append([own, *numbers, number(100 * inside, ".1f")])
    head = ["error of ours", "over bound", "over reachable", "95 % intervals, %"]
    return "\n\n".join(
        [
            of_all("rmse", "diameter, root mean square error, mm"),
            of_all("bias", "diameter, mean error, mm"),
            of_all("failures", "failures, %", 100),
            of_all("time", "time, ms", 1),
            table(head, rows),
        ]
    )
