"""Base class of buffers, with the transformation and conversion of objects of registered types."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any, ClassVar

from geometry_msgs.msg import PointStamped, PoseStamped, PoseWithCovarianceStamped, TransformStamped, Vector3Stamped
from rclpy.duration import Duration
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

NO_TIME = Duration()


class TypeException(Exception):
    """Raised for an object whose type is not registered."""

    def __init__(self, errstr: str) -> None:
        super().__init__(errstr)
        self.errstr = errstr


class NotImplementedException(Exception):
    """Raised when a subclass of `BufferInterface` does not implement a lookup."""

    def __init__(self) -> None:
        super().__init__()
        self.errstr = "CanTransform or LookupTransform not implemented"


class BufferInterface:
    """Base class of buffers; subclasses implement the methods that look transforms up."""

    def __init__(self) -> None:
        self.registration = TransformRegistration()

    def transform(
        self, object_stamped: Any, target_frame: str, timeout: Duration = NO_TIME, new_type: Any = None
    ) -> Any:
        """Return an object with a header transformed to another frame, at the time in its header.

        The type must be registered, for example by an import of tf2_geometry_msgs. The result is converted to
        `new_type`, if that is given.

        Raises:
            TypeException: the type is not registered. Others as `lookup_transform`.
        """
        function = self.registration.get(type(object_stamped))
        header = object_stamped.header
        transform = self.lookup_transform(target_frame, header.frame_id, header.stamp, timeout)
        result = function(object_stamped, transform)
        return result if new_type is None else convert(result, new_type)

    def transform_full(
        self,
        object_stamped: Any,
        target_frame: str,
        target_time: Time,
        fixed_frame: str,
        timeout: Duration = NO_TIME,
        new_type: Any = None,
    ) -> Any:
        """Return an object transformed to another frame and time; `fixed_frame` is assumed not to move in between."""
        function = self.registration.get(type(object_stamped))
        source = object_stamped.header.frame_id, object_stamped.header.stamp
        transform = self.lookup_transform_full(target_frame, target_time, *source, fixed_frame, timeout)
        result = function(object_stamped, transform)
        return result if new_type is None else convert(result, new_type)

    def lookup_transform(self, *args: Any, **kwargs: Any) -> Any:
        """Raise `NotImplementedException`; subclasses implement this and the other three methods for lookups."""
        raise NotImplementedException

    lookup_transform_full = can_transform = can_transform_full = lookup_transform


def Stamped(obj: Any, stamp: Any, frame_id: str) -> Any:
    """Set the header of an object to a stamp and a frame, and return the object."""
    obj.header = Header(frame_id=frame_id, stamp=stamp)
    return obj


class TransformRegistration:
    """Shared table of the functions that transform objects, by type.

    Each function takes an object and a TransformStamped.
    """

    _types: ClassVar[dict[Any, Callable[[Any, Any], Any]]] = {}

    def print_me(self) -> None:
        print(self._types)

    def add(self, key: Any, callback: Callable[[Any, Any], Any]) -> None:
        self._types[key] = callback

    def get(self, key: Any) -> Callable[[Any, Any], Any]:
        """Return the function that transforms objects of a type; raise `TypeException` if there is none."""
        return _get_registered(self._types, key)


class ConvertRegistration:
    """Shared tables of the functions that convert objects to messages, from messages, and to other types."""

    _to_msg: ClassVar[dict[Any, Callable[[Any], Any]]] = {}
    _from_msg: ClassVar[dict[Any, Callable[[Any], Any]]] = {}
    _convert: ClassVar[dict[Any, Callable[[Any], Any]]] = {}

    def add_from_msg(self, key: Any, callback: Callable[[Any], Any]) -> None:
        """Register the function that creates objects of a type from messages."""
        self._from_msg[key] = callback

    def add_to_msg(self, key: Any, callback: Callable[[Any], Any]) -> None:
        """Register the function that creates messages from objects of a type."""
        self._to_msg[key] = callback

    def add_convert(self, key: Any, callback: Callable[[Any], Any]) -> None:
        """Register a function that converts objects directly; the key is a tuple of both types."""
        self._convert[key] = callback

    def get_from_msg(self, key: Any) -> Callable[[Any], Any]:
        """Return the function that creates objects of a type from messages; raise `TypeException` if there is none."""
        return _get_registered(self._from_msg, key)

    def get_to_msg(self, key: Any) -> Callable[[Any], Any]:
        """Return the function that creates messages from objects of a type; raise `TypeException` if there is none."""
        return _get_registered(self._to_msg, key)

    def get_convert(self, key: Any) -> Callable[[Any], Any]:
        """Return the function that converts between a tuple of types; raise `TypeException` if there is none."""
        return _get_registered(self._convert, key)


def convert(a: Any, b_type: Any) -> Any:
    """Convert an object to another type, by a direct conversion if one is registered, else by way of a message.

    Raises:
        TypeException: no conversion is registered.
    """
    registration = ConvertRegistration()
    try:
        conversion = registration.get_convert((type(a), b_type))
    except TypeException:
        if type(a) is b_type:
            return deepcopy(a)
        to_message, from_message = registration.get_to_msg(type(a)), registration.get_from_msg(b_type)
        return from_message(to_message(a))
    return conversion(a)


def _get_registered(table: dict[Any, Callable[..., Any]], key: Any) -> Callable[..., Any]:
    if key not in table:
        raise TypeException(f"Type {key} is not loaded or supported")
    return table[key]
