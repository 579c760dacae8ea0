"""Keystores and policies of SROS2, without a ROS installation."""

from rosidl_py_gen.cdr.lazy import stub_exports

__getattr__, __dir__, __all__ = stub_exports(__name__)
