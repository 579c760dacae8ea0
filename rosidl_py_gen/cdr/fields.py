"""What the layout of structured arrays needs to know of a message class and its fields, which are in `message.py`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Protocol

if TYPE_CHECKING:
    from rosidl_py_gen.base.fieldtype import FieldType


class FieldLike(Protocol):
    """A row of the field table; see `message.Field`."""

    @property
    def ros_name(self) -> str: ...

    @property
    def cls(self) -> type[MessageLike] | None: ...

    @property
    def type(self) -> FieldType: ...


class MessageLike(Protocol):
    """A generated message; see `message.Message`. The fields of its `_TYPE` are `FieldLike`."""

    _TYPE: ClassVar[Any]

    def _encode(self) -> bytes: ...

    @classmethod
    def _decode(cls, data: Any, copy: bool = False, arrays: bool = False) -> Any: ...
