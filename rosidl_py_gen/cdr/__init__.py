"""What generated code needs at run time: base classes, CDR support, lazy packages (standard library and numpy only).

Loaded piece by piece, so that importing a generated package costs next to nothing until a message is used.
"""

from rosidl_py_gen.cdr.lazy import stub_exports

__getattr__, __dir__, __all__ = stub_exports(__name__)
