"""Results of an experiment, with all that is needed to repeat it."""

__all__ = [
    "Metric",
    "read_spreads",
    "read_values",
    "result_folder",
    "save_run",
    "three_digits",
]

import dataclasses
import json
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import jax

from impostor_jax.io.atomic import write_json
from impostor_jax.io.provenance import cpu_model, git_output, package_versions


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


def save_run(
    folder: Path,
    metrics: Sequence[Metric],
    config: Any,
    *,
    seed: int,
    dtype: str,
    seconds: float,
    quick: bool,
) -> None:
    """Write `results.json`.

    Args:
        folder: The experiment's folder; a temporary one where `quick`.
        metrics: What was measured.
        config: Dataclass of settings, as they were used.
        seed: Of all that was drawn.
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
        _check_clean(folder)
    device = jax.devices()[0]
    settings = {
        name: str(value) if isinstance(value, Path) else value
        for name, value in dataclasses.asdict(config).items()
    }
    record = {
        "commit": git_output("rev-parse", "HEAD"),
        "quick": quick,
        "seed": seed,
        "dtype": dtype,
        "seconds": seconds,
        "device": {"platform": device.platform, "kind": device.device_kind},
        "machine": {"cpu": cpu_model(), "cores": os.cpu_count()},
        "versions": package_versions(),
        "config": settings,
        "metrics": [dataclasses.asdict(metric) for metric in metrics],
    }
    write_json(folder / "results.json", record)


def read_values(folder: Path) -> dict[str, Any]:
    """Value of each metric of a folder's `results.json`, by name; None if unknown."""
    return {name: value for name, (value, _) in read_spreads(folder).items()}


def read_spreads(folder: Path) -> dict[str, tuple[float | None, float | None]]:
    """Value and spread of each metric of a folder's `results.json`, by name."""
    record = json.loads((folder / "results.json").read_text())
    return {m["name"]: (m["value"], m["spread"]) for m in record["metrics"]}


def three_digits(value: float | None) -> str:
    """Three digits, or all that stand before the point; nothing for None."""
    if value is None:
        return ""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def result_folder(output: Path | None, home: Path, *, quick: bool) -> Path:
    """Folder of a run's results; before a long run, refuse code that no commit has.

    Args:
        output: Where the user wants them.
        home: The experiment's own folder, the default; a trial gets a temporary one.
        quick: Whether this is a trial.

    Raises:
        ValueError: The code is not committed.
    """
    if output is None:
        output = Path(tempfile.mkdtemp()) if quick else home
    if not quick:
        _check_clean(output)
    return output


def _check_clean(folder: Path) -> None:
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
        pathspecs += [
            f":(top,exclude){own}/{name}" for name in ("results.json", "figures")
        ]
    changed = git_output(
        "status", "--porcelain", "--untracked-files=all", "--", *pathspecs
    )
    if changed:
        raise ValueError(
            "the code of a recorded run must be committed; commit or use --quick. "
            f"Changed files:\n{changed}"
        )
