"""The tables of the README from results.json."""

__all__ = ["tables"]

from experiments.markdown import table
from experiments.recording import Results

WAYS = {"one": "one process", "two": "two processes", "dask": "dask, two workers"}


def tables(results: Results) -> str:
    """Rates, memory, and what kills and broken files change."""
    values = results.values
    rates = table(
        ["", "images an hour", "seconds in all", "rows equal"],
        [
            [
                label,
                f"{values[f'rate.{way}']:.0f}",
                f"{values[f'start.{way}']:.0f}",
                f"{values.get(f'equal.{way}', 1):.1%}",
            ]
            for way, label in WAYS.items()
        ],
    )
    lines = (
        f"Largest process: {values['memory.quarter']:.0f} MiB for a quarter of the "
        f"images, {values['memory.whole']:.0f} MiB for all.",
        f"Bytes a row: CSV {values['bytes.csv']:.0f}, "
        f"Parquet {values['bytes.parquet']:.0f}.",
        f"Equal tables after a worker was killed: {values['killed.worker.equal']:.0%}; "
        f"after a run was killed and resumed: {values['killed.run.equal']:.0%}.",
        f"Of images cut short {values['broken.failed']:.0f} are rows that failed, the "
        f"exit code is {values['broken.code']:.0f}, and of the other rows "
        f"{values['broken.equal']:.1%} are equal.",
    )
    return "\n\n".join([rates, "\n".join(lines)])
