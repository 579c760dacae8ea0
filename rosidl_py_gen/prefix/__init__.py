"""Ament prefix of source packages, made without a build, and launch files that run with one."""

from rosidl_py_gen.cdr.lazy import stub_exports

__getattr__, __dir__, __all__ = stub_exports(__name__)
