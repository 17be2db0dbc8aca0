"""How a command ends: with its exit code, or with one line that says why not."""

__all__ = ["BAD_INPUT", "INTERRUPTED", "NOT_READ", "end_of", "stream_beside"]

import os
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from impostor_jax.io.atomic import is_standard_output

BAD_INPUT = 2
"""Exit code where an argument or a file is bad, or a file cannot be written."""

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it: 128 and the number of the signal."""

NOT_READ = 141
"""Exit code where nobody reads what is printed any more, as after `head`; of SIGPIPE,
likewise."""


def end_of(program: str, run: Callable[[], int]) -> int:
    """Run a command; returns the exit code.

    Args:
        program: Its name, for the line on stderr.
        run: Returns the exit code; a `ValueError`, an `OSError` or an `ImportError`, as
            of what a package lacks, is `BAD_INPUT`.
    """
    hook, sys.unraisablehook = sys.unraisablehook, _interrupted_again
    try:
        try:
            code = run()
        except SystemExit:  # Of --help and --version, which print.
            _flush_output()
            raise
        _flush_output()
        return code
    except BrokenPipeError as error:
        # A pipe that has a name is a file that was to be written.
        message, code = None, NOT_READ
        if error.filename is not None:
            message, code = str(error), BAD_INPUT
    except (ValueError, OSError, ImportError) as error:
        message, code = " ".join(str(error).split()), BAD_INPUT
    except MemoryError:
        message, code = "there is not enough memory", BAD_INPUT
    except KeyboardInterrupt as interrupt:
        message, code = str(interrupt) or "interrupted", INTERRUPTED
    finally:
        sys.unraisablehook = hook
    _forget_output()
    if message is not None:
        print(f"{program}: error: {message}", file=sys.stderr)
    return code


def _interrupted_again(found: Any) -> None:
    """Interrupt once more where the first time was lost.

    It came while Python ran what must not raise, as JAX's callback of the garbage
    collector; there Python prints the exception and goes on.
    """
    if issubclass(found.exc_type, KeyboardInterrupt):
        # From a thread, and later: here it would be lost again.
        main = threading.main_thread().ident or 0
        threading.Timer(0.02, signal.pthread_kill, (main, signal.SIGINT)).start()
    else:
        sys.__unraisablehook__(found)


def stream_beside(*files: Path | None) -> Any:
    """Where lines for a reader go: to stderr if a file is printed on stdout."""
    is_printed = any(file is not None and is_standard_output(file) for file in files)
    return sys.stderr if is_printed else sys.stdout


def _flush_output() -> None:
    """Write what was printed; else a full disk is found when Python ends, too late."""
    if sys.stdout is not None:
        sys.stdout.flush()


def _forget_output() -> None:
    """Drop what was printed and cannot be written; Python would try once more."""
    try:
        _flush_output()
    except OSError:
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), sys.stdout.fileno())
