"""Where compiled programs are kept: what one process has compiled, the next need not.

Nothing here needs JAX, so that a command can say where before JAX starts.
"""

__all__ = ["compiled_folder", "keep_compiled"]

import os
from pathlib import Path


def compiled_folder() -> Path:
    """`impostor_jax/compiled` in `$XDG_CACHE_HOME`, `~/.cache` if it is not set."""
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(home) / "impostor_jax" / "compiled"


def keep_compiled() -> None:
    """Let JAX keep all that a command compiles in the user's cache folder.

    In a library's user's process the package's own programs alone are kept there
    (`impostor_jax.program_store`). JAX's own variables, where they are set, decide
    otherwise. Call it before JAX is imported: it reads them then.
    """
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(compiled_folder()))
    # A fit is made of many small programs besides the large ones.
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.1")
