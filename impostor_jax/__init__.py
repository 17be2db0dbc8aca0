"""Differentiable impostor rendering of cylinders, and their fit to depth images.

The public names are listed in `__init__.pyi` and load on first use, so that a command
line can be parsed before JAX starts.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
