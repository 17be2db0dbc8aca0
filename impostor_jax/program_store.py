"""Compiled programs on disk, from which a new process loads them without tracing.

They lie in `impostor_jax.caching.compiled_folder`, or in the folder of JAX's own cache
of compiled programs where the user has set one, and nowhere where the user has switched
that off. JAX's settings stay as they are: they are the user's. Whoever may write to
that folder runs code as the user, as with JAX's own cache.

An entry serves the same source of this package, the same versions of what it is made
with, and the same processor: its name tells. Whatever goes wrong, in reading or in
writing, a program is compiled as if there were no store.
"""

__all__ = ["load", "place_of", "save"]

import contextlib
import functools
import hashlib
import os
import pickle
import platform
import sys
import tempfile
import zlib
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.experimental import serialize_executable

from impostor_jax.caching import compiled_folder
from impostor_jax.device import Device

LIBRARIES = ("equinox", "jax", "jaxlib", "lineax", "numpy", "optimistix")
"""What a program is made with, besides this package."""

MACHINE_CODE = (b"\x7fELF", b"\xcf\xfa\xed\xfe")
"""How it begins on Linux and on macOS. What JAX has loaded from its own cache, and is
serialized again, holds none and would fail when it is called."""

CACHE_SETTINGS = ("jax_compilation_cache_dir", "jax_enable_compilation_cache")
"""Of JAX, that say where compiled programs are kept, and whether."""

MOST_ENTRIES = 300
"""That are kept: of a fit some 0.5 MB each. The oldest make room for new ones."""


def place_of(parts: tuple[Any, ...]) -> Path | None:
    """Where a program is kept; None where programs are not.

    Args:
        parts: What decides what is compiled, besides the package and the machine; each
            says in its `repr` all that it is.
    """
    text, folder = repr(parts), _folder()
    # The address of an object says nothing to another process.
    if folder is None or " at 0x" in text:
        return None
    name = hashlib.sha256(f"{_surroundings()}{text}".encode()).hexdigest()
    return folder / name


def save(program: jax.stages.Compiled, place: Path) -> None:
    """Keep a program; does nothing where it cannot be kept."""
    with contextlib.suppress(Exception):
        payload, *trees = serialize_executable.serialize(program)
        if not any(magic in payload for magic in MACHINE_CODE):
            return
        # A tree that holds a class of this package cannot be pickled, its values can.
        values = [tree.unflatten(range(tree.num_leaves)) for tree in trees]
        entry = zlib.compress(pickle.dumps((payload, *values)), level=1)
        place.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        _make_room(place.parent)
        # A reader meets all of it or nothing, whoever writes at the same time.
        with tempfile.TemporaryDirectory(dir=place.parent) as scratch:
            written = Path(scratch, "entry")
            written.write_bytes(entry)
            written.replace(place)


def load(place: Path, device: Device) -> Callable[..., Any] | None:
    """A program that was kept; None where there is none, or it cannot be read."""
    with contextlib.suppress(Exception):
        # The checksum of zlib keeps what is damaged from being run.
        payload, *values = pickle.loads(zlib.decompress(place.read_bytes()))
        if b"lapack_" in payload:
            # JAX does this where it lowers a program; without it the process crashes.
            from jaxlib import lapack

            lapack.prepare_lapack_call("potrf", np.dtype(np.float32))
        trees = map(jax.tree.structure, values)
        return serialize_executable.deserialize_and_load(
            payload, *trees, backend=device.platform, execution_devices=[device]
        )
    return None


def _folder() -> Path | None:
    """Folder of the entries; None where JAX's settings say that nothing is kept."""
    of_jax, is_enabled = (getattr(jax.config, name) for name in CACHE_SETTINGS)
    if of_jax == "" or not is_enabled:
        return None
    # Into what is no folder only JAX knows how to write.
    if of_jax is None or "://" in of_jax:
        of_jax = compiled_folder()
    return Path(of_jax) / "impostor_jax"


def _make_room(folder: Path) -> None:
    """Delete the oldest entries before one is added."""
    entries = [path for path in folder.iterdir() if path.is_file()]
    entries.sort(key=lambda path: path.stat().st_mtime)
    for path in entries[: 1 - MOST_ENTRIES]:
        path.unlink(missing_ok=True)


@functools.cache
def _surroundings() -> str:
    """The package's source, the versions, and the processor."""
    package = Path(__file__).parent
    source = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        source.update(str(path.relative_to(package)).encode() + path.read_bytes())
    facts = [sys.version, *map(version, LIBRARIES), _processor(), os.cpu_count()]
    return repr((source.hexdigest(), os.environ.get("XLA_FLAGS"), *facts))


def _processor() -> str:
    """Model and instructions: XLA compiles for this very processor."""
    described = Path("/proc/cpuinfo")
    if described.exists():
        first = described.read_text().split("\n\n")[0].splitlines()
        names = ("model name", "flags", "Features", "CPU part")
        return "".join(line for line in first if line.startswith(names))
    return platform.processor() + platform.version()
