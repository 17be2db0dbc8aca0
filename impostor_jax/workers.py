"""Work that several processes share, handed out as it is done."""

__all__ = ["dask_executor", "done_by", "number_of_workers"]

import concurrent.futures
import contextlib
import itertools
import logging
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

Input = TypeVar("Input")
Output = TypeVar("Output")

WAITING = 1000
"""Most inputs that are handed to an executor and not done yet."""

MOST_DEATHS = 3
"""Times that workers may die one after the other, and nothing be done in between."""


def number_of_workers(workers: int | None) -> int:
    """Number of processes; one a processor if None.

    Raises:
        ValueError: It is less than 1.
    """
    if workers is None:
        return len(os.sched_getaffinity(0))
    if workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    return workers


def done_by(
    work: Callable[[Input], Output],
    inputs: Iterable[Input],
    executor: Executor | None,
    workers: int,
) -> Generator[Output]:
    """What is made of inputs, in the order in which it is ready.

    Where a process of the pool is killed, another does what it was about.

    Args:
        work: Takes an input; both, and what it returns, are sent between processes.
        inputs: Are taken as they are needed.
        executor: What runs the work; a pool of processes if None.
        workers: Number of processes of that pool.

    Raises:
        ChildProcessError: Processes of the pool die again and again.
        ConnectionError: The executor gave up, as one of dask whose scheduler is gone.
    """
    own, rest = executor is None, iter(inputs)
    again: list[Input] = []
    deaths = 0
    while True:
        runs = _pool(workers) if executor is None else executor
        waiting: dict[Future[Output], Input] = {}
        try:
            while True:
                with _interrupts_kept_back():
                    more = itertools.chain(again, rest)
                    for one in itertools.islice(more, WAITING - len(waiting)):
                        waiting[runs.submit(work, one)] = one
                    again = []
                if not waiting:
                    return
                done, _ = concurrent.futures.wait(
                    waiting, return_when=concurrent.futures.FIRST_COMPLETED
                )
                for future in done:
                    result = future.result()
                    del waiting[future]
                    deaths = 0
                    yield result
        except BrokenProcessPool as error:
            deaths += 1
            if not own:
                raise
            if deaths > MOST_DEATHS:
                raise ChildProcessError(
                    "the processes that do the work die again and again, as where "
                    "memory ends, of which fewer of them take less, or where a script "
                    "that starts them does so without if __name__ == '__main__'"
                ) from error
            again = list(waiting.values())
        except CancelledError as error:
            raise ConnectionError(
                "the work was given up by what did it, as where the scheduler of dask "
                "is gone; resuming it does the rest"
            ) from error
        finally:
            for future in waiting:
                future.cancel()
            if own:
                runs.shutdown()


@contextlib.contextmanager
def dask_executor(address: str, tell: Callable[[str], Any]) -> Iterator[Executor]:
    """The workers of a dask scheduler; waits until there is one.

    Args:
        address: Of the scheduler, as `tcp://host:8786`.
        tell: Is told if there is none yet.

    Raises:
        ValueError: Dask is not installed.
        OSError: There is no scheduler.
    """
    try:
        from dask.distributed import Client
    except ImportError as error:
        raise ValueError(
            "dask needs the extra scale: pip install 'impostor-jax[scale]'"
        ) from error
    with Client(address) as client:
        # Of a scheduler that is gone an error tells, in one line.
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        if not client.scheduler_info()["workers"]:
            tell(f"the scheduler {address} has no workers yet: waiting for one")
            client.wait_for_workers(1)
        yield client.get_executor(pure=False)


def _pool(workers: int) -> Executor:
    return ProcessPoolExecutor(
        workers,
        multiprocessing.get_context("spawn"),
        initializer=_begin_worker,
        initargs=(max(1, len(os.sched_getaffinity(0)) // workers),),
    )


@contextlib.contextmanager
def _interrupts_kept_back() -> Iterator[None]:
    """Let an interrupt wait, and processes that are begun here never see one.

    They would print where they were, until `_begin_worker` has them ignore it.
    """
    kept: list[int] = []
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    # Another thread may take it, and then the main one runs the handler all the same: a
    # process whose start is cut short there prints that it was told nothing.
    handler = None
    if threading.current_thread() is threading.main_thread():
        handler = signal.signal(signal.SIGINT, lambda number, _: kept.append(number))
    try:
        yield
    finally:
        # None of another thread, and where it was not set by Python.
        if handler is not None:
            signal.signal(signal.SIGINT, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if kept:
            signal.raise_signal(signal.SIGINT)


def _begin_worker(threads: int) -> None:
    """Let only the parent end this process, and let it end with the parent.

    An interrupt from the keyboard reaches all processes: workers finish their work.
    Without the thread they would wait for work for ever after a parent that was killed.

    Args:
        threads: Of XLA. If each process had one for every processor, they would wait
            for each other's: an image would take a fifth longer.
    """
    # Read when the first array is made, which the import of JAX does not do.
    os.environ.setdefault("PJRT_NPROC", str(threads))
    # The first would else take most of a graphics card's memory for itself.
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait() -> None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
