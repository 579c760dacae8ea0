"""ROS 2 nodes in Python: topics, services, actions, parameters, graph, QoS, clocks and timers.

The public names are defined in `__init__.pyi`, and imported when they are first used. The library of Cyclone DDS is
loaded when the first context with DDS is opened.
"""

from rosidl_py_gen.cdr.lazy import stub_exports

__getattr__, __dir__, __all__ = stub_exports(__name__)
