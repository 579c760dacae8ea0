"""Filters that combine messages of several topics by their stamps: exact and approximate synchronizers, and a cache.

The synchronizers make the same sets of messages as the Python package message_filters of ROS 2.
"""

from rosidl_py_gen.cdr.lazy import stub_exports

__getattr__, __dir__, __all__ = stub_exports(__name__)
