"""Entry point of `impostor-jax` and of `python -m impostor_jax`."""

__all__ = ["main"]

import sys

from impostor_jax.caching import keep_compiled
from impostor_jax.cli.ending import end_of
from impostor_jax.cli.parse import parse


def main() -> int:
    """Run the command line; returns the exit code."""

    def run() -> int:
        command = parse(sys.argv[1:])
        keep_compiled()
        return command.run()

    return end_of("impostor-jax", run)


if __name__ == "__main__":
    sys.exit(main())
