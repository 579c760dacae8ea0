"""States of service introspection, which decide what a service publishes about its requests: nothing, metadata, or
contents.
"""

from rclpy._rclpy_pybind11 import EnumOfC


class ServiceIntrospectionState(EnumOfC):
    """Contents of the introspection events of a service: none, metadata, or also the requests and responses."""

    OFF = 0
    METADATA = 1
    CONTENTS = 2
