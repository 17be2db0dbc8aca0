"""What one run of a command has compiled, the next one need not."""

__all__ = ["keep_compiled"]

import os
from pathlib import Path


def keep_compiled() -> None:
    """Let JAX keep compiled programs in the user's cache folder.

    That is `impostor_jax/compiled` in `$XDG_CACHE_HOME`, `~/.cache` if it is not set.
    JAX's own variables, where they are set, decide otherwise. Call it before JAX is
    imported: it reads them then.
    """
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folder = Path(home) / "impostor_jax" / "compiled"
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(folder))
    # A fit is made of many small programs besides the large ones.
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.1")
