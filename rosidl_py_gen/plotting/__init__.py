"""Plots of fields of messages over time, as a file, in a window or in the terminal."""

from rosidl_py_gen.cdr.lazy import stub_exports

__getattr__, __dir__, __all__ = stub_exports(__name__)
