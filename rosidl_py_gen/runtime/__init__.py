"""ROS 2 nodes in Python: topics, services, actions, parameters, graph, QoS, clocks and timers over Cyclone DDS.

The public names stand in `__init__.pyi`, for type checkers and for us. Each is imported when it is first used; Cyclone
DDS itself only when a context without transport is opened.
"""

from rosidl_py_gen.cdr.lazy import stub_exports

__getattr__, __dir__, __all__ = stub_exports(__name__)
