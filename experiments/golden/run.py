"""Fit what an earlier version has fitted, and compare with the record of that."""

__all__ = ["Config", "measure"]

import dataclasses
import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from experiments.golden.cases import KINDS, real
from experiments.golden.record import Entry, apart, entry_of, read, write
from experiments.golden.report import tables
from experiments.recording import RECORD, Metric
from experiments.running import RunConfig, main

FAR = 1e-3
"""Standard deviations by which an estimate moves that is not the same."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Compare what fits say with what they said."""

    run: RunConfig = RunConfig()
    folder: Path | None = None
    """Folder of real images, which are not part of the project."""
    cases: int = 1000
    """Of each kind, at most."""


def measure(config: Config) -> Iterator[Metric]:
    """All kinds of cases; the new record takes the place of the old one."""
    kinds = dict(KINDS)
    if config.run.quick:
        kinds = {"small": KINDS["small"]}
    elif config.folder is not None:
        folder = config.folder
        kinds["real"] = lambda: real(folder)
    before, after = read(Path(__file__).with_name(RECORD)), {}
    for kind, cases in kinds.items():
        found = {}
        for case in itertools.islice(cases(), config.cases):
            found[f"{kind}: {case.name}"] = entry_of(case.fit)
        yield from _compared(kind, before, found)
        after |= found
    assert config.run.output is not None
    # What is not fitted this time stays as it was.
    write(config.run.output / RECORD, before | after)


def _compared(
    kind: str, before: Mapping[str, Entry], after: Mapping[str, Entry]
) -> Iterator[Metric]:
    """How many fits say something else, how far they go, and the time."""
    n, known = len(after), [name for name in after if name in before]
    right = sum(one["status"] == "converged" for one in after.values())
    yield Metric(f"{kind}.cases", n, None, "fits", "higher", n)
    yield Metric(f"{kind}.converged", right, None, "fits", "higher", n)
    changed, moves = 0, []
    for name in known:
        old, new = before[name], after[name]
        if old["status"] != new["status"]:
            changed += 1
            print(f"{name}: {old['status']} becomes {new['status']}")
        elif old["status"] == "converged":
            moves.append(apart(old, new))
            if moves[-1] > FAR:
                print(f"{name}: {moves[-1]:.2g} deviations from where it was")
    yield Metric(f"{kind}.changed", changed, None, "fits", "lower", len(known))
    far = int(np.sum(np.array(moves) > FAR))
    yield Metric(f"{kind}.moved", far, None, "fits", "lower", len(moves))
    largest = max(moves, default=0.0)
    yield Metric(f"{kind}.largest", largest, None, "deviations", "lower", len(moves))
    # Of those that both know, or of all where nothing was known.
    for name, entries in (("before", before), ("after", after)):
        times = [entries[one]["ms"] / 1e3 for one in known or after if one in entries]
        for quantity, value in (("seconds", sum(times)), ("worst", max([0, *times]))):
            metric = f"{kind}.{quantity}.{name}"
            yield Metric(metric, value, None, "s", "lower", len(times))


if __name__ == "__main__":
    main(Config, measure, tables, Config(cases=3))
