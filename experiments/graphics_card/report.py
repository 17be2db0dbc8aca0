"""The tables of the README from results.json."""

__all__ = ["tables"]

from experiments.markdown import number, table, three_digits
from experiments.recording import Results

DEVICES = ("processor", "card")


def tables(results: Results) -> str:
    """A row for each case, and one for each error."""
    rows = []
    for case in results.cases("", ".card.time"):
        times = [results.pair(f"{case}.{name}.time") for name in DEVICES]
        firsts = [results.values.get(f"{case}.{name}.first") for name in DEVICES]
        both = None not in (times[0][0], times[1][0])
        gain = times[0][0] / times[1][0] if both else None
        cells = [cell for pair in times for cell in map(three_digits, pair)]
        rows.append([case, *cells, number(gain, ".2g"), *map(three_digits, firsts)])
    head = [
        *("call", "processor, ms", "spread", "card, ms", "spread", "ratio"),
        *("first on the processor, s", "first on the card, s"),
    ]
    errors = {
        "pixels that only one sees": "error.mask",
        "largest error of the depth, eps": "error.depth",
        "largest error of the normal, eps": "error.normal",
    }
    checks = [[label, number(results.values[key])] for label, key in errors.items()]
    return f"{table(head, rows)}\n\n{table(['a can on the card', 'found'], checks)}"
