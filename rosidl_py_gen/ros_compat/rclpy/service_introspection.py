"""States of service introspection."""

from rclpy._rclpy_pybind11 import EnumOfC


class ServiceIntrospectionState(EnumOfC):
    """Content of service events: none, metadata, or the requests and responses as well."""

    OFF = 0
    METADATA = 1
    CONTENTS = 2
