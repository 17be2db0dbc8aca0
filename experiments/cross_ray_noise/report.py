"""The tables of the README from results.json."""

__all__ = ["draw", "tables"]

from collections.abc import Mapping

from matplotlib.figure import Figure

from experiments.cross_ray_noise.programs import PROGRAMS
from experiments.markdown import number, table, three_digits
from experiments.recording import Results

NAMES = tuple(PROGRAMS)
OURS = NAMES[:3]


def tables(results: Results) -> str:
    """Bias, spread, intervals and times of all programs, and what was learned."""
    values, spreads = results.values, results.spreads
    cases = results.cases("", ".learned.failures")

    def of_all(quantity: str, head: str, scale: float, form: str, names=NAMES) -> str:
        rows = []
        for case in cases:
            found = [values.get(f"{case}.{name}.{quantity}") for name in names]
            scaled = [None if x is None else scale * x for x in found]
            rows.append([case, *(number(x, form) for x in scaled)])
        return table([head, *names], rows)

    learned = []
    for case in cases:
        own = f"{case}.learned.across"
        numbers = values.get(own), spreads.get(own), values.get(f"{case}.across")
        scaled = [None if x is None else 1e3 * x for x in numbers]
        learned.append([case, *map(three_digits, scaled)])
    head = ["error across the ray, mm", "learned", "spread", "true"]
    return "\n\n".join(
        [
            of_all("inside", "95 % intervals that hold, %", 100, ".0f", NAMES[:4]),
            of_all("bias", "mean error of the radius, mm", 1e3, ".4f"),
            of_all("rmse", "root mean square error, mm", 1e3, ".3f"),
            of_all("bias_over_spread", "mean over spread", 1, ".2f"),
            of_all("failures", "failures, %", 100, ".0f"),
            of_all("time", "time, ms", 1, ".0f"),
            table(head, learned),
        ]
    )


def draw(_: Results) -> Mapping[str, Figure]:
    """Nothing: all there is to see are a few numbers."""
    return {}
