"""ROS 2 nodes in Python: topics, services, actions, parameters, graph, QoS, clocks and timers over Cyclone DDS.

The public names stand in `__init__.pyi`, for type checkers and for us. Each is imported when it is first used; Cyclone
DDS itself only when a context without transport is opened.
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
