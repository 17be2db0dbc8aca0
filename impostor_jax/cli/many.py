"""What commands do with many images or clouds, and their flags for that."""

__all__ = ["Many", "check_given", "is_one", "run_on_many"]

import collections
import contextlib
import dataclasses
import glob
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from impostor_jax.io.atomic import check_output_folder

if TYPE_CHECKING:
    from impostor_jax.many.items import AbstractItem
    from impostor_jax.many.tasks import AbstractTask

TABLE = "results.csv"
"""In the output folder, where no other is asked for."""

OF_SEVERAL = (".tar", ".txt")
"""Endings of files that stand for several images; the second with a camera alone."""


@dataclasses.dataclass(frozen=True)
class Many:
    """Of many images or clouds."""

    table: Path | None = None
    """Table of all that is found or fitted, .csv or .parquet; results.csv in the output
    folder if none is given."""
    only_table: bool = False
    """Write the table alone, and no folder for each image."""
    workers: int = 1
    """Number of processes."""
    dask: str | None = None
    """Address of a dask scheduler whose workers see the same files (extra: scale)."""
    resume: bool = False
    """Leave out what is done already, from the same files with the same options and
    version: the rest of an interrupted run, or images that came since."""

    @property
    def is_asked(self) -> bool:
        """Whether any of them is given: a single image goes the way of many then."""
        return self != Many()

    def check(self) -> None:
        """Raise a `ValueError` where a flag is seen to be bad without JAX."""
        from impostor_jax.workers import number_of_workers

        number_of_workers(self.workers)
        if self.dask is not None and self.workers != 1:
            raise ValueError("--workers must not be given together with --dask")


def is_one(given: Sequence[Path], camera: Path | None) -> bool:
    """Whether what is given is a single image or cloud in a file of its own."""
    if len(given) != 1 or given[0].is_dir():
        return False
    (path,), several = given, OF_SEVERAL if camera is not None else OF_SEVERAL[:1]
    if path.suffix.lower() in several:
        return False
    return path.exists() or not glob.has_magic(str(path))


def check_given(given: Sequence[Path], camera: Path | None, origin: Any) -> None:
    """Raise a `ValueError` where nothing is given, or one of several does not exist.

    Or where images, which have a camera, are given an origin.
    """
    if not given:
        raise ValueError("a depth image must be given, got none")
    for path in given if len(given) > 1 else ():
        if not path.exists() and not glob.has_magic(str(path)):
            raise ValueError(f"{str(path)!r} does not exist")
    if origin is not None and camera is not None:
        raise ValueError("--origin must be given with clouds alone, not --camera")


def run_on_many(
    items: "Sequence[AbstractItem]", task: "AbstractTask", output: Path, many: Many
) -> int:
    """Do a task on images, and write a table of all; the exit code.

    That is 1 if an image failed or a fit did not succeed, or if nothing was found.
    """
    from tqdm import tqdm

    from impostor_jax.io.tables import check_table, write_rows
    from impostor_jax.many.journal import Journal
    from impostor_jax.many.mapping import FAILED, JOURNAL, done_on
    from impostor_jax.many.tasks import NOTHING

    table = many.table or output / TABLE
    check_output_folder(output, (JOURNAL, TABLE))
    if many.table is not None:
        check_table(table, "table")
    tell = partial(tqdm.write, file=sys.stderr)
    start, statuses = time.perf_counter(), collections.Counter()
    good = True
    with contextlib.ExitStack() as stack:
        executor = None
        if many.dask is not None:
            from impostor_jax.workers import dask_executor

            executor = stack.enter_context(dask_executor(many.dask, tell))
        made = done_on(
            items,
            task,
            output,
            workers=many.workers,
            executor=executor,
            is_resumed=many.resume,
            has_files=not many.only_table,
        )
        stack.enter_context(contextlib.closing(made))
        bar = tqdm(made, total=len(items), unit="image", disable=None, file=sys.stderr)
        try:
            for one in bar:
                if one.failed is not None:
                    tell(f"{one.name}: {one.failed}")
                statuses.update(row["status"] for row in one.rows)
                good &= all(row.get("success", True) for row in one.rows)
        except KeyboardInterrupt as interrupt:
            rest = "interrupted; --resume does the rest"
            raise KeyboardInterrupt(rest) from interrupt
    names = [one.name for one in items]
    with contextlib.closing(Journal(output / JOURNAL, True)) as journal:

        def rows() -> Any:
            return (row for one in journal.entries(names) for row in one.rows)

        write_rows(rows, table)
    counts = ", ".join(f"{count} {status}" for status, count in statuses.most_common())
    seconds = time.perf_counter() - start
    print(f"{len(items)} images in {seconds:.1f} s: {counts}; table {str(table)!r}")
    is_good = good and not statuses[FAILED] and {*statuses} != {NOTHING}
    return 0 if is_good else 1
