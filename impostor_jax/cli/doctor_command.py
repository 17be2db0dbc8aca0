"""The command `impostor-jax doctor`."""

__all__ = ["DoctorCommand"]

import contextlib
import dataclasses
import importlib.metadata
import itertools
import os
import platform
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from impostor_jax.caching import compiled_folder
from impostor_jax.io.provenance import cpu_model, version_of

DISTRIBUTION = "impostor-jax"

LONGEST_S = 20.0
"""Time after which a probe is given up: a broken driver may hang."""

MOST_FILES = 100_000
"""Of the cache that are counted."""

# Drivers may end a process, and hang in it, so each is asked in one of its own.
DEVICES = """
import jax
for device in jax.devices():
    print(f"{device.platform} {device.id}: {device.device_kind}")
"""
DRIVERS = """
import moderngl
for index in range(8):
    try:
        context = moderngl.create_context(
            standalone=True, require=330, backend="egl", device_index=index
        )
    except Exception as error:
        if not index:
            raise
        break
    print(context.info["GL_RENDERER"], "with OpenGL", context.info["GL_VERSION"])
    context.release()
"""


@dataclasses.dataclass(frozen=True)
class DoctorCommand:
    """Print what a report of a problem needs.

    Versions, JAX's devices, OpenGL drivers, the cache, and what of the extras is there.
    The exit code is 0, whatever is missing.
    """

    def run(self) -> int:
        """Run the command; returns the exit code."""
        devices, drivers = _started(DEVICES), _started(DRIVERS)
        version = version_of(DISTRIBUTION) or "not installed"
        lines = [
            ("version", version),
            ("python", f"{platform.python_version()} on {platform.platform()}"),
            ("processor", _processor()),
        ]
        required, extras = _requirements()
        for name in required:
            lines.append((name, version_of(name) or "missing"))
        lines.append(("OpenCV", _opencv()))
        lines += [("device", found) for found in _found(devices)]
        lines += [("OpenGL", found) for found in _found(drivers)]
        lines.append(("cache", _cache()))
        for extra, names in extras.items():
            versions = (f"{name} {version_of(name) or 'missing'}" for name in names)
            lines.append((f"extra {extra}", ", ".join(versions)))
        width = max(len(name) for name, _ in lines)
        for name, what in lines:
            print(f"{name:<{width}}  {what}")
        return 0


def _opencv() -> str:
    """Whether it works, and how to mend it where several of it are installed."""
    try:
        from impostor_jax.opencv import advice, cv2, distributions
    except ImportError as error:
        return f"broken: {error}"
    several = f"; {advice()}" if len(distributions()) > 1 else ""
    return f"{cv2.__version__}{several}"


def _requirements() -> tuple[list[str], dict[str, list[str]]]:
    """Names of what is always needed, and of what each extra for users needs."""
    try:
        given = importlib.metadata.requires(DISTRIBUTION) or []
    except importlib.metadata.PackageNotFoundError:
        given = []
    required: list[str] = []
    extras: dict[str, list[str]] = {}
    for line in given:
        name = re.split(r"[^\w.-]", line, maxsplit=1)[0]
        extra = re.search(r"extra\s*==\s*['\"]([\w-]+)['\"]", line)
        if extra is None:
            required.append(name)
        elif extra[1] != "test":
            extras.setdefault(extra[1], []).append(name)
    return required, extras


def _processor() -> str:
    """Model, and number of cores that this process may use."""
    allowed = getattr(os, "sched_getaffinity", None)
    count = len(allowed(0)) if allowed is not None else os.cpu_count()
    return f"{cpu_model() or platform.machine()}, {count} cores"


def _started(program: str) -> subprocess.Popen[str]:
    """A process that prints a line for each thing that it finds."""
    # A GPU's memory is not taken for a look at it.
    environment = os.environ | {"XLA_PYTHON_CLIENT_PREALLOCATE": "false"}
    return subprocess.Popen(
        [sys.executable, "-c", program],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        env=environment,
    )


def _found(probe: subprocess.Popen[str]) -> list[str]:
    """What a process printed; or why it found nothing, in a line."""
    try:
        out, errors = probe.communicate(timeout=LONGEST_S)
    except subprocess.TimeoutExpired:
        probe.kill()
        # Not waited for without end: what hangs in a driver may not end even so.
        with contextlib.suppress(subprocess.TimeoutExpired):
            probe.communicate(timeout=1)
        return [f"no answer in {LONGEST_S:.0f} s"]
    if lines := out.split("\n")[:-1]:
        return lines
    last = errors.strip().splitlines()[-1:] or [f"exit code {probe.returncode}"]
    return [f"none ({last[0][:200]})"]


def _cache() -> str:
    """Where compiled programs are kept, and how much that is."""
    folder = Path(os.environ.get("JAX_COMPILATION_CACHE_DIR") or compiled_folder())
    sizes = list(itertools.islice(_sizes(folder), MOST_FILES))
    # A report is pasted where others read it: the user's name is not told.
    home, name = str(Path.home()), str(folder)
    shown = f"~{name[len(home) :]}" if name.startswith(f"{home}{os.sep}") else name
    return f"{shown}, {len(sizes)} files of {sum(sizes) / 1e6:.1f} MB"


def _sizes(folder: Path) -> Iterator[int]:
    """Bytes of each file below a folder; none where it cannot be read."""
    for place, _, names in os.walk(folder):
        for name in names:
            # Another process may remove it now.
            with contextlib.suppress(OSError):
                yield os.lstat(os.path.join(place, name)).st_size
