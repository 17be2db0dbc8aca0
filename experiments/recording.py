"""Results of an experiment, with all that is needed to repeat it."""

__all__ = ["RECORD", "Metric", "Results", "check_clean", "save_run"]

import dataclasses
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import jax

from impostor_jax.io.atomic import write_json
from impostor_jax.io.provenance import cpu_model, git_output, package_versions

RECORD = "record.json"
"""What an experiment keeps beside its results, for its next run."""


@dataclasses.dataclass(frozen=True)
class Metric:
    """One measured number.

    Attributes:
        name: Dotted, from the case to the quantity.
        value: None where it could not be measured.
        spread: Of single measurements, as the experiment's README defines it; None
            where there is none.
        unit: Of value and spread.
        better: Direction that is an improvement.
        n: Number of measurements.
    """

    name: str
    value: float | None
    spread: float | None
    unit: str
    better: Literal["lower", "higher"]
    n: int

    @staticmethod
    def share(
        name: str, part: float | None, n: int, better: Any = "higher"
    ) -> "Metric":
        """A part of `n`, with its standard error; None where there are none."""
        spread = None if part is None else float((part * (1 - part) / n) ** 0.5)
        return Metric(name, part, spread, "1", better, n)


@dataclasses.dataclass(frozen=True)
class Results:
    """What an experiment has found.

    Attributes:
        values: Of each metric, by its name; None if unknown.
        spreads: The same of the spreads.
    """

    values: dict[str, Any]
    spreads: dict[str, Any]

    @staticmethod
    def read(folder: Path) -> "Results":
        """Those of a folder's `results.json`."""
        metrics = json.loads((folder / "results.json").read_text())["metrics"]
        values, spreads = (
            {metric["name"]: metric[field] for metric in metrics}
            for field in ("value", "spread")
        )
        return Results(values, spreads)

    def pair(self, name: str) -> tuple[Any, Any]:
        """Value and spread; None where it was not measured."""
        return self.values.get(name), self.spreads.get(name)

    def cases(self, start: str, end: str) -> list[str]:
        """Names of metrics that begin and end so, without their end."""
        return [
            name.removesuffix(end)
            for name in self.values
            if name.startswith(start) and name.endswith(end)
        ]


def save_run(
    folder: Path,
    metrics: Sequence[Metric],
    config: Mapping[str, Any],
    *,
    dtype: str,
    seconds: float,
    quick: bool,
) -> None:
    """Write `results.json`.

    Args:
        folder: The experiment's folder; a temporary one where `quick`.
        metrics: What was measured.
        config: Settings, as they were used.
        dtype: Floating-point type of the computation.
        seconds: Wall time of the run.
        quick: Whether this is a trial, which may run on uncommitted code.

    Raises:
        ValueError: The code is not committed, or two metrics have one name.
    """
    names = [metric.name for metric in metrics]
    if len(set(names)) < len(names):
        raise ValueError(f"metrics must have names of their own, got {names}")
    if not quick:
        check_clean(folder)
    device = jax.devices()[0]
    record = {
        "commit": git_output("rev-parse", "HEAD"),
        "quick": quick,
        "seed": config.get("seed", 0),
        "dtype": dtype,
        "seconds": seconds,
        "device": {"platform": device.platform, "kind": device.device_kind},
        "machine": {"cpu": cpu_model(), "cores": os.cpu_count()},
        "versions": package_versions(),
        "config": config,
        "metrics": [dataclasses.asdict(metric) for metric in metrics],
    }
    write_json(folder / "results.json", record)


def check_clean(folder: Path) -> None:
    """Refuse a tree that no commit describes.

    The files that a run writes into `folder` do not count. Without git nothing is
    refused.

    Raises:
        ValueError: A file differs from the commit.
    """
    root = git_output("rev-parse", "--show-toplevel")
    if root is None:
        return
    pathspecs = [":(top)"]
    if folder.resolve().is_relative_to(root):
        own = folder.resolve().relative_to(root).as_posix()
        written = ("results.json", RECORD, "figures", "README.md")
        pathspecs += [f":(top,exclude){own}/{name}" for name in written]
    changed = git_output(
        "status", "--porcelain", "--untracked-files=all", "--", *pathspecs
    )
    if changed:
        raise ValueError(
            "the code of a recorded run must be committed; commit or use --quick. "
            f"Changed files:\n{changed}"
        )
