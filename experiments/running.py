"""The command that every experiment is: measure, record, draw and write the tables."""

__all__ = ["RunConfig", "main"]

import dataclasses
import inspect
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

import jax.numpy as jnp
import tyro
from matplotlib.figure import Figure
from tqdm import tqdm

from experiments.markdown import with_tables
from experiments.recording import Metric, Results, check_clean, save_run
from impostor_jax.io.atomic import write_atomically, write_text

DPI = 100
"""Of the figures."""


@dataclasses.dataclass(frozen=True)
class RunConfig:
    """What every experiment can be told."""

    quick: bool = False
    """Few and small cases: a trial of the code, no measurement."""

    output: Path | None = None
    """Folder of the results; the experiment's own by default, a temporary one with
    --quick."""


class Settings(Protocol):
    """A frozen dataclass of what an experiment can be told."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def run(self) -> RunConfig:
        """What every experiment can be told."""
        ...


Config = TypeVar("Config", bound=Settings)


def main(
    config_type: type[Config],
    measure: Callable[[Config], Iterable[Metric]],
    tables: Callable[[Results], str],
    trial: Config,
    draw: Callable[[Results], Mapping[str, Figure]] | None = None,
) -> None:
    """Run an experiment as its command line says, and write what it finds.

    Args:
        config_type: Its settings; each field is a flag.
        measure: Measures; the output that it is told is the folder of the results.
        tables: What stands in its README between the marks.
        trial: The settings of a quick run.
        draw: Its figures by their names, if it has some.
    """
    config = tyro.cli(config_type, config=(tyro.conf.OmitArgPrefixes,))
    run = config.run
    try:
        _check_counts(config)
        folder = run.output or Path(inspect.getfile(measure)).parent
        if run.quick:
            folder = run.output or Path(tempfile.mkdtemp())
            config = trial
        else:
            # Before a long run.
            check_clean(folder)
        run = RunConfig(run.quick, folder)
        started = time.perf_counter()
        metrics = measure(dataclasses.replace(config, run=run))
        metrics = list(tqdm(metrics, unit=" metrics"))
        seconds = time.perf_counter() - started
        settings = dataclasses.asdict(config)
        del settings["run"]
        # Where files lie is no part of what was measured.
        settings = {k: x for k, x in settings.items() if not isinstance(x, Path)}
        dtype = str(jnp.zeros(()).dtype)
        save_run(
            folder, metrics, settings, dtype=dtype, seconds=seconds, quick=run.quick
        )
    except (ValueError, OSError) as problem:
        sys.exit(str(problem))
    results = Results.read(folder)
    for name, figure in draw(results).items() if draw else ():
        _save(figure, folder / "figures" / f"{name}.png")
    text, readme = tables(results), folder / "README.md"
    if readme.exists():
        write_text(readme, with_tables(readme.read_text(), text))
    print(f"{text}\n\nwritten to {folder}")


def _check_counts(config: Settings) -> None:
    """Raise a `ValueError` where a number of things is less than one."""
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        # A seed, whose default is 0, is no number of things.
        if type(value) is int and field.default and value < 1:
            raise ValueError(f"{field.name} must be at least 1, got {value}")


def _save(figure: Figure, path: Path) -> None:
    def save(partial: Path) -> None:
        figure.savefig(partial, dpi=DPI, format="png")

    write_atomically(path, save)
