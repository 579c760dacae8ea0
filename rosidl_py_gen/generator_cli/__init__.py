"""Command line `rosidl-py-gen`, and the parts of it that `rosidl-py` has, too.

`commands` has the commands with their options; only `diff` has modules of its own. `command_line` and `shells` have the
texts, options and completion of both command lines.
"""

from rosidl_py_gen.cdr.lazy import stub_exports

__getattr__, __dir__, __all__ = stub_exports(__name__)
