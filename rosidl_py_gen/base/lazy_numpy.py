"""Replacement for the module numpy that imports numpy at the first use of a name, because the import slows the start of
small programs.

The import takes a quarter of the start of a small program. ``from rosidl_py_gen.base import lazy_numpy as np`` replaces
``import numpy as np``. As long as no module has imported numpy, no object is an array or a number of numpy, so tests
with `isinstance` and ``type(x) is`` do not import numpy.

Thread: any. Two threads may both import numpy: the second one waits for the first in the import.
"""

from __future__ import annotations

import gc
import sys

HAS_GIL = getattr(sys, "_is_gil_enabled", lambda: True)()
"""False in a free-threaded Python whose GIL was disabled when this module was imported."""


class _NoInstances:
    """Class without instances, which replaces a class of numpy in `isinstance` tests until numpy is imported."""


def __getattr__(name: str) -> object:
    if name in ("generic", "integer", "ndarray") and "numpy" not in sys.modules:
        return _NoInstances
    is_collecting = gc.isenabled()
    gc.disable()  # saves a tenth of the time of the import
    try:
        import numpy
    finally:
        if is_collecting:
            gc.enable()
    globals().update((key, value) for key, value in vars(numpy).items() if not key.startswith("__"))
    if HAS_GIL:
        # The interpreter reads attributes of a module without `__getattr__` faster. Without the GIL another thread may
        # have missed a name before the update, and looks for `__getattr__` next.
        globals().pop("__getattr__", None)
    return getattr(numpy, name)
