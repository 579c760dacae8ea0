"""Common parts of the commands of ``rosidl-py`` and of the packages that do their work: errors, output, node, graph."""

from rosidl_py_gen.cdr.lazy import stub_exports

__getattr__, __dir__, __all__ = stub_exports(__name__)
