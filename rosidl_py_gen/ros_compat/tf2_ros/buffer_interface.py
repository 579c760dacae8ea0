"""What buffers have in common: transforming and converting objects of registered types."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any, ClassVar

from rclpy.duration import Duration
from rclpy.time import Time
from std_msgs.msg import Header

NO_TIME = Duration()


class TypeException(Exception):
    """Nothing was registered for a type."""

    def __init__(self, errstr: str) -> None:
        super().__init__(errstr)
        self.errstr = errstr


class NotImplementedException(Exception):
    """A buffer does not say how it looks transforms up."""

    def __init__(self) -> None:
        super().__init__()
        self.errstr = "CanTransform or LookupTransform not implemented"


class BufferInterface:
    """A buffer; a subclass says how it looks transforms up."""

    def __init__(self) -> None:
        self.registration = TransformRegistration()

    def transform(
        self, object_stamped: Any, target_frame: str, timeout: Duration = NO_TIME, new_type: Any = None
    ) -> Any:
        """An object with a header in another frame, by the transform of its own time.

        Its type must be registered, as importing tf2_geometry_msgs does. `new_type`: what it is converted to.

        Raises:
            TypeException: it is not registered. Others as `lookup_transform`.
        """
        transformed = self.registration.get(type(object_stamped))
        header = object_stamped.header
        found = self.lookup_transform(target_frame, header.frame_id, header.stamp, timeout)
        answer = transformed(object_stamped, found)
        return answer if new_type is None else convert(answer, new_type)

    def transform_full(
        self,
        object_stamped: Any,
        target_frame: str,
        target_time: Time,
        fixed_frame: str,
        timeout: Duration = NO_TIME,
        new_type: Any = None,
    ) -> Any:
        """The same at another time, as `fixed_frame` does not move in between."""
        transformed = self.registration.get(type(object_stamped))
        source = object_stamped.header.frame_id, object_stamped.header.stamp
        found = self.lookup_transform_full(target_frame, target_time, *source, fixed_frame, timeout)
        answer = transformed(object_stamped, found)
        return answer if new_type is None else convert(answer, new_type)

    def lookup_transform(self, target_frame: str, source_frame: str, time: Time, timeout: Duration = NO_TIME) -> Any:
        """How coordinates in `source_frame` become coordinates in `target_frame`."""
        raise NotImplementedException

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = NO_TIME,
    ) -> Any:
        """The same between two times."""
        raise NotImplementedException

    def can_transform(self, target_frame: str, source_frame: str, time: Time, timeout: Duration = NO_TIME) -> Any:
        """Whether `lookup_transform` would give something."""
        raise NotImplementedException

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = NO_TIME,
    ) -> Any:
        """Whether `lookup_transform_full` would give something."""
        raise NotImplementedException


def Stamped(obj: Any, stamp: Any, frame_id: str) -> Any:
    """The object, with a header."""
    obj.header = Header(frame_id=frame_id, stamp=stamp)
    return obj


class TransformRegistration:
    """How objects of a type are transformed: functions of the object and a TransformStamped. All share one table."""

    _types: ClassVar[dict[Any, Callable[[Any, Any], Any]]] = {}

    def print_me(self) -> None:
        """Print the table."""
        print(self._types)

    def add(self, key: Any, callback: Callable[[Any, Any], Any]) -> None:
        """Register a type."""
        self._types[key] = callback

    def get(self, key: Any) -> Callable[[Any, Any], Any]:
        """The function of a type; raises `TypeException` when there is none."""
        return _registered(self._types, key)


class ConvertRegistration:
    """How objects are converted: to messages, from messages, and from one type to another. All share these tables."""

    _to_msg: ClassVar[dict[Any, Callable[[Any], Any]]] = {}
    _from_msg: ClassVar[dict[Any, Callable[[Any], Any]]] = {}
    _convert: ClassVar[dict[Any, Callable[[Any], Any]]] = {}

    def add_from_msg(self, key: Any, callback: Callable[[Any], Any]) -> None:
        """Register what makes objects of a type out of a message."""
        self._from_msg[key] = callback

    def add_to_msg(self, key: Any, callback: Callable[[Any], Any]) -> None:
        """Register what makes a message out of objects of a type."""
        self._to_msg[key] = callback

    def add_convert(self, key: Any, callback: Callable[[Any], Any]) -> None:
        """Register what converts; the key is a tuple of both types."""
        self._convert[key] = callback

    def get_from_msg(self, key: Any) -> Callable[[Any], Any]:
        """Raises `TypeException` when there is none."""
        return _registered(self._from_msg, key)

    def get_to_msg(self, key: Any) -> Callable[[Any], Any]:
        """Raises `TypeException` when there is none."""
        return _registered(self._to_msg, key)

    def get_convert(self, key: Any) -> Callable[[Any], Any]:
        """Raises `TypeException` when there is none."""
        return _registered(self._convert, key)


def convert(a: Any, b_type: Any) -> Any:
    """An object as one of another type: directly if that is registered, else through a message.

    Raises:
        TypeException: no way is registered.
    """
    known = ConvertRegistration()
    try:
        direct = known.get_convert((type(a), b_type))
    except TypeException:
        if type(a) is b_type:
            return deepcopy(a)
        to_message, from_message = known.get_to_msg(type(a)), known.get_from_msg(b_type)
        return from_message(to_message(a))
    return direct(a)


def _registered(table: dict[Any, Callable[..., Any]], key: Any) -> Callable[..., Any]:
    if key not in table:
        raise TypeException(f"Type {key} is not loaded or supported")
    return table[key]
