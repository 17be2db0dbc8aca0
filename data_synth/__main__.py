"""Entry point of `impostor-synth` and of `python -m data_synth`."""

__all__ = ["main"]

import os
import sys

from data_synth.cli import parse
from impostor_jax.caching import keep_compiled
from impostor_jax.cli.ending import end_of


def main() -> int:
    """Run the command line; returns the exit code."""
    return end_of("impostor-synth", _run)


def _run() -> int:
    command = parse(sys.argv[1:])
    keep_compiled()
    # The first process would else take most of a GPU's memory for itself.
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    # Workers keep freed memory, in large pages: else the system clears new pages for
    # every batch, a tenth of the time.
    kept = {"hugetlb": 1, "mmap_threshold": 2**30, "trim_threshold": 2**31}
    tunables = ":".join(f"glibc.malloc.{name}={n}" for name, n in kept.items())
    os.environ.setdefault("GLIBC_TUNABLES", tunables)
    return command.run()


if __name__ == "__main__":
    sys.exit(main())
