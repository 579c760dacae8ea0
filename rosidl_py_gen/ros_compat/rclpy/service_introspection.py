"""How much is published of what passes services."""

from __future__ import annotations

from rclpy._rclpy_pybind11 import EnumOfC


class ServiceIntrospectionState(EnumOfC):
    """Nothing, who and when, or requests and responses themselves, too."""

    OFF = 0
    METADATA = 1
    CONTENTS = 2
