"""ROS 2 nodes in Python: topics, services, actions, parameters, graph, QoS, clocks and timers.

The public names are defined in `__init__.pyi`, and imported when they are first used. Cyclone DDS is loaded when the
first context of that transport is opened.
"""

from typing import TYPE_CHECKING

from rosidl_py_gen.cdr.lazy import stub_exports

_find, __dir__, __all__ = stub_exports(__name__)

if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        if name not in __all__ and not name.startswith("_"):
            import sys

            from rosidl_py_gen.runtime.names.rclpy_hints import HINTS, unknown_attribute

            if name in HINTS:
                # ``from module import name`` discards the text of an AttributeError.
                is_import = sys._getframe(1).f_code.co_name == "_handle_fromlist"
                raise (ImportError if is_import else AttributeError)(unknown_attribute(__name__, name))
        return _find(name)
