"""The tables of the README from results.json."""

__all__ = ["tables"]

from experiments.markdown import number, table
from experiments.recording import Results


def tables(results: Results) -> str:
    """Size of each page, and what each window takes."""
    sizes = [
        [page, number(results.values[f"{page}.size"] / 1e6, ".2g")]
        for page in results.cases("", ".size")
    ]
    rows = []
    for case in results.cases("", ".open"):
        ms, spread = results.pair(f"{case}.frame")
        size = results.values.get(f"{case}.picture")
        rows.append(
            [
                case.replace(".", ", "),
                number(results.values[f"{case}.open"], ".2g"),
                number(ms, ".3g", spread),
                "" if size is None else number(size / 1e3, ".0f"),
            ]
        )
    head = ["page, window", "s to open", "ms a frame", "kB of its picture"]
    return f"{table(['page', 'MB'], sizes)}\n\n{table(head, rows)}"
