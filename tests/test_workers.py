"""Work that processes share: what is lost when one is killed."""

import os
import signal
from concurrent.futures import Executor, Future
from functools import partial
from pathlib import Path

import pytest

from impostor_jax import workers
from impostor_jax.workers import dask_executor, done_by, number_of_workers

# Processes import this file: nothing here needs JAX.


def number_once_killed(path: Path, number: int) -> int:
    """A number; the first process that gets here with 3 is killed."""
    if number == 3 and not path.exists():
        path.write_text("")
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def always_killed(number: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_what_a_killed_worker_was_about_is_done_by_another(tmp_path):
    work = partial(number_once_killed, tmp_path / "killed")
    assert sorted(done_by(work, range(8), None, 2)) == [*range(8)]
    assert (tmp_path / "killed").exists()


def test_workers_that_always_die_end_the_work(monkeypatch):
    monkeypatch.setattr(workers, "MOST_DEATHS", 1)
    with pytest.raises(ChildProcessError, match="die again and again"):
        list(done_by(always_killed, range(2), None, 1))


class GoneExecutor(Executor):
    """As that of a dask client whose scheduler is gone."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.cancel()
        future.set_running_or_notify_cancel()
        return future


def test_work_that_an_executor_gives_up_is_an_error():
    with pytest.raises(ConnectionError, match="given up by what did it"):
        list(done_by(str, range(2), GoneExecutor(), 1))


def test_there_is_a_worker_at_least():
    with pytest.raises(ValueError, match="workers must be at least 1, got 0"):
        number_of_workers(0)
    assert number_of_workers(None) >= 1


@pytest.mark.filterwarnings("ignore")  # of the cluster's, when it ends
def test_a_scheduler_without_workers_is_said_and_waited_for():
    distributed = pytest.importorskip("dask.distributed")
    told = []
    cluster = distributed.LocalCluster(
        n_workers=0, threads_per_worker=1, processes=False, dashboard_address=None
    )

    def tell(line):
        told.append(line)
        cluster.scale(1)

    with cluster, dask_executor(cluster.scheduler_address, tell) as executor:
        assert sorted(done_by(str, range(3), executor, 1)) == ["0", "1", "2"]
    assert len(told) == 1
    assert "has no workers yet: waiting for one" in told[0]
