"""Entry point of `impostor-jax` and of `python -m impostor_jax`."""

__all__ = ["main"]

import sys

from impostor_jax.cli.compiled import keep_compiled
from impostor_jax.cli.parse import parse


def main() -> int:
    """Run the command line; returns the exit code."""
    command = parse(sys.argv[1:])
    keep_compiled()
    try:
        return command.run()
    except (ValueError, OSError) as error:
        message = " ".join(str(error).split())
        print(f"impostor-jax: error: {message}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
