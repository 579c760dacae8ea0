"""Bags: recorded messages as MCAP files and rosbag2 folders, read and written without ROS.

Needs the extra ``mcap``; without it the import raises `ExtraMissingError`, an `ImportError` that has the command.
"""

from rosidl_py_gen.base.extras import Extra as _Extra
from rosidl_py_gen.cdr.lazy import stub_exports

# The modules of this package load late; packages of the extra are imported now, so that a missing one is reported here.
try:
    import mcap as _mcap  # noqa: F401
    import yaml as _yaml  # noqa: F401

    from rosidl_py_gen.bags.storage import zstd as _zstd  # noqa: F401
except ModuleNotFoundError as missing:
    raise _Extra.missing_error(missing) or missing from None

__getattr__, __dir__, __all__ = stub_exports(__name__)
