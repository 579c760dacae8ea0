"""Run-time support of generated code: base classes, CDR codec, lazy packages (standard library and numpy only).

Each module is imported when one of its names is first used, so that importing a generated package is cheap.
"""

from rosidl_py_gen.cdr.lazy import stub_exports

__getattr__, __dir__, __all__ = stub_exports(__name__)
