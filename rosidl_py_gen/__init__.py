"""ROS 2 in Python from pip alone: typed message packages, CDR, type support.

The public names are listed in `__init__.pyi`; their modules are imported on first use. The node runtime is
`rosidl_py_gen.runtime` and needs the extra ``node``.
"""

from rosidl_py_gen.cdr.lazy import stub_exports

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = stub_exports(__name__)
