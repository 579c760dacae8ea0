"""Classes that annotations may write with type arguments, as ``Publisher[String]``."""

from types import GenericAlias
from typing import Any


class Subscriptable:
    """Class with any type arguments, which have no effect; classes of rclpy are generic since Kilted."""

    def __class_getitem__(cls, arguments: Any) -> Any:
        return GenericAlias(cls, arguments)
