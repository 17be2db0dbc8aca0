"""The tables of the README, from results.json."""

__all__ = ["tables"]

from experiments.markdown import percent, table, three_digits
from experiments.recording import Results
from impostor_jax.fit.status import FitStatus


def tables(results: Results) -> str:
    """What became of each kind of scenes, and the fits that are wrong."""
    values, names = results.values, results.cases("", ".right")
    head = ["scenes", "right", "wrong", "of these gross", "ambiguous", "truth told"]
    head += [str(status) for status in FAILURES]
    rows = []
    for name in names:
        counts = (values.get(f"{name}.status.{status}", 0) for status in FAILURES)
        rows.append(
            [
                name,
                percent(values[f"{name}.right"]),
                str(values[f"{name}.wrong"]),
                str(values[f"{name}.gross"]),
                str(values.get(f"{name}.status.{FitStatus.AMBIGUOUS}", 0)),
                str(values[f"{name}.told"]),
                *map(str, counts),
                three_digits(values[f"{name}.time"]),
            ]
        )
    blocks = [table([*head, "ms"], rows)]
    wrong = [
        [
            f"{name}, seed {case.rpartition('.')[2]}",
            three_digits(values[case]),
            three_digits(values[f"{case}.axis"]),
        ]
        for name in names
        for case in results.cases(f"{name}.wrong.", ".axis")
    ]
    if wrong:
        blocks.append(table(["wrong", "deviations off", "axis off, degrees"], wrong))
    return "\n\n".join(blocks)


FAILURES = [
    status
    for status in FitStatus
    if status not in (FitStatus.CONVERGED, FitStatus.AMBIGUOUS, FitStatus.CONTRADICTED)
]
"""Statuses of fits that failed, and say so; nothing is stated that readings could
contradict."""
