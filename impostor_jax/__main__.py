"""Entry point of `impostor-jax` and of `python -m impostor_jax`."""

__all__ = ["main"]

import os
import sys

from impostor_jax.caching import keep_compiled
from impostor_jax.cli.doctor_command import DoctorCommand
from impostor_jax.cli.ending import end_of
from impostor_jax.cli.parse import parse


def main() -> int:
    """Run the command line; returns the exit code."""

    def run() -> int:
        command = parse(sys.argv[1:])
        keep_compiled()
        # What one command draws or fits is done before a graphics card has started.
        if not isinstance(command, DoctorCommand):
            os.environ.setdefault("JAX_PLATFORMS", "cpu")
        return command.run()

    return end_of("impostor-jax", run)


if __name__ == "__main__":
    sys.exit(main())
