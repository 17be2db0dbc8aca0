"""Files. Units stand in the names of their fields and end at this boundary.

What reads and writes files of others has its public names in `__init__.pyi`, as the
package has: `ij.io.read_points`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
