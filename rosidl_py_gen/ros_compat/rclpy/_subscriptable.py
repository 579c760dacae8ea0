"""Base class of classes whose annotations may have type arguments, such as ``Publisher[String]``."""

from types import GenericAlias
from typing import Any


class Subscriptable:
    """Base of a class that accepts type arguments, without effect; classes of rclpy are generic since Kilted."""

    def __class_getitem__(cls, arguments: Any) -> Any:
        return GenericAlias(cls, arguments)
