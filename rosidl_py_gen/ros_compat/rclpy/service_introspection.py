"""States of service introspection: off, metadata, contents."""

from rclpy._rclpy_pybind11 import EnumOfC


class ServiceIntrospectionState(EnumOfC):
    """Contents of the introspection events of a service: none, metadata, or also the requests and responses."""

    OFF = 0
    METADATA = 1
    CONTENTS = 2
