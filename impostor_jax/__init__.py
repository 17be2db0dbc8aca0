"""Differentiable impostor rendering of cylinders, and their fit to depth images.

The public names are listed in `__init__.pyi` and load on first use, so that a command
line can be parsed before JAX starts.
"""

from typing import Any

import lazy_loader

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    # On demand: it is read from a file, and a copy that is not installed has none.
    if name == "__version__":
        from importlib.metadata import version

        return version("impostor-jax")
    return _load(name)
