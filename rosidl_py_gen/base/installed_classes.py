"""Generated classes that `import` finds: of packages that users generated, of `msgs`, and of what a wheel holds ready.

Decides that nothing is imported that this tool did not generate.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.base.generated_files import is_generated
from rosidl_py_gen.base.names import py_name

if TYPE_CHECKING:
    from importlib.machinery import ModuleSpec

    from rosidl_py_gen.base.names import RosName

PREGENERATED_PACKAGE = "rosidl_py_gen.ready_made."
"""The bundled interfaces, generated while a wheel is built; a checkout has none. Import prefix."""


def find_installed_class(name: RosName, *roots: str) -> type | None:
    """The generated class that `import` finds, without importing anything this tool did not generate.

    Args:
        roots: import prefixes, tried in turn; nothing means what users generated, then `rosidl_py_gen.msgs`.
    """
    for root in roots or ("", "rosidl_py_gen.msgs."):
        # The import hook can put modules of its own into a package, and only those of this tool's files are meant here.
        if not (_is_ours(root + name.package) and _is_ours(f"{root}{name.package}.{name.kind}")):
            continue
        try:
            package = import_module(f"{root}{name.package}.{name.kind}")
            cls = getattr(package, py_name(name.name), None)
        except ImportError:
            continue
        if isinstance(cls, type) and getattr(getattr(cls, "_TYPE", None), "name", "") == str(name):
            return cls
    return None


def _is_ours(package: str) -> bool:
    loaded = sys.modules.get(package)
    try:
        spec: ModuleSpec | None = loaded.__spec__ if loaded is not None else find_spec(package)
    except (ImportError, ValueError, AttributeError):
        return False
    origin = spec.origin if spec is not None else None
    if origin is None or not origin.endswith("__init__.py"):
        return False
    return is_generated(Path(origin))
