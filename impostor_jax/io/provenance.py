"""What made a result: versions, commit and processor, for its record."""

__all__ = ["cpu_model", "git_output", "package_versions", "version_of"]

import importlib.metadata
import platform
import subprocess
from pathlib import Path

PACKAGES = ("jax", "jaxlib", "numpy", "optimistix")
"""Distributions whose versions are in a record."""


def package_versions() -> dict[str, str | None]:
    """Version of Python and of the packages that results depend on."""
    versions: dict[str, str | None] = {"python": platform.python_version()}
    versions |= {name: version_of(name) for name in PACKAGES}
    # Any of its distributions may be the one that is there.
    from impostor_jax.opencv import distributions

    versions["opencv"] = next(iter(distributions().values()), None)
    return versions


def version_of(name: str) -> str | None:
    """Version of an installed distribution; None where there is none."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def git_output(*arguments: str) -> str | None:
    """Output of git in the tree that this package belongs to.

    None where git fails, or where the package is no part of a tree.
    """

    def run(*command: str) -> str:
        done = subprocess.run(
            ["git", *command],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.rstrip()

    try:
        # An installed copy may lie in the tree of somebody else.
        run("ls-files", "--error-unmatch", Path(__file__).name)
        return run(*arguments)
    except (OSError, subprocess.CalledProcessError):
        return None


def cpu_model() -> str | None:
    """Name of the processor; None where the system does not tell."""
    cpuinfo = Path("/proc/cpuinfo")
    for line in cpuinfo.read_text().splitlines() if cpuinfo.exists() else ():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor() or None
