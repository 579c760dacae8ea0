"""numpy, imported when one of its names is first used: it takes a quarter of the start of a small program.

``from rosidl_py_gen.base import lazy_numpy as np`` replaces ``import numpy as np``. As long as no module has imported
numpy, no object is an array or a number of numpy; tests with `isinstance` and ``type(x) is`` do not import it then.
"""

from __future__ import annotations

import gc
import sys


class _NoInstances:
    """Stand-in for a class of numpy before numpy is imported."""


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
    globals().pop("__getattr__", None)  # the interpreter reads attributes of a module without it faster
    return getattr(numpy, name)
