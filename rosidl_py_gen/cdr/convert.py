"""Conversion between messages and plain Python values or JSON.

Keys are ROS names of fields. JSON has no NaN and no infinities: they are the strings "NaN", "Infinity" and "-Infinity",
which `from_dict` accepts as well.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, TypeVar

from rosidl_py_gen.base import lazy_numpy as np
from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.terminal_text import json_text
from rosidl_py_gen.cdr.arrays import DTYPES, FieldValueError, coerce, short_repr
from rosidl_py_gen.cdr.codec import validate
from rosidl_py_gen.cdr.message import Field, Message, require_message
from rosidl_py_gen.cdr.structured_arrays import StructuredCodec
from rosidl_py_gen.errors import EncodeError

M = TypeVar("M", bound=Message)

_SPECIAL_FLOATS = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}


def to_dict(message: Message) -> dict[str, Any]:
    """Return the message as dicts, lists and scalars, which `from_dict` reads; arrays become lists.

    Raises:
        EncodeError: a value does not fit its type; names the path.
        TypeNotFoundError: the argument is not a generated message.
    """
    try:
        return _plain_message(message)
    except (AttributeError, TypeError, FieldValueError):
        validate(message)
        raise


def _plain_message(message: Message) -> dict[str, Any]:
    return {field.ros_name: _plain(message._get_plain(field), field) for field in message._TYPE.fields}


def _plain(value: Any, field: Field) -> Any:
    if field.cls is not None:
        if isinstance(value, np.ndarray):
            codec = StructuredCodec.find(field.cls)
            if codec is None:
                raise TypeError(f"{field.cls._TYPE.name} is not of fixed size")
            value = codec.to_messages(value)
        scalar = field.type.arity is Arity.SCALAR
        return _plain_message(value) if scalar else [_plain_message(item) for item in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    if field.type.arity is not Arity.SCALAR:
        return [item.item() if isinstance(item, np.generic) else item for item in value]
    return value.item() if isinstance(value, np.generic) else value


def to_json(message: Message, *, indent: int | None = None) -> str:
    """Return the message as JSON text, which `from_json` reads.

    Raises:
        EncodeError: a value does not fit its type; names the path.
        TypeNotFoundError: the argument is not a generated message.
    """
    try:
        return json_text(to_dict(message), indent=indent, for_terminal=False)
    except TypeError:
        validate(message)
        raise


def from_json(cls: type[M], text: str | bytes) -> M:
    """Return a message built from JSON text; missing fields have their defaults.

    Raises:
        EncodeError: the text is not JSON, a key is unknown, or a value does not fit; names the path.
        TypeNotFoundError: `cls` is not a generated message class.
    """
    require_message(cls)
    try:
        values = json.loads(text)
    except (ValueError, TypeError, RecursionError) as error:
        raise EncodeError(cls._TYPE.name, f"expected JSON, found another text: {error}") from None
    return from_dict(cls, values)


def from_dict(cls: type[M], values: Mapping[str, Any]) -> M:
    """Return a message built from plain values by field name; missing fields have their defaults.

    Raises:
        EncodeError: a key is unknown, or a value does not fit; names the path.
        TypeNotFoundError: `cls` is not a generated message class.
    """
    require_message(cls)
    message = _build(cls, values, cls._TYPE.name)
    validate(message)
    return message


def _build(cls: type[M], values: Any, path: str) -> M:
    if not isinstance(values, Mapping):
        raise EncodeError(path, f"expected a mapping of fields, found {short_repr(values)}")
    message = cls()
    fields = {field.ros_name: field for field in cls._TYPE.fields}
    for key, value in values.items():
        field = fields.get(key)
        if field is None:
            hint = did_you_mean(str(key), fields)
            raise EncodeError(path, f'unknown field "{short_repr(key)[1:-1] if isinstance(key, str) else key}"{hint}')
        message._set_plain(field, _value(value, field, f"{path}.{key}"))
    return message


def _value(value: Any, field: Field, path: str) -> Any:
    kind = field.type
    if field.cls is not None:
        if kind.arity is Arity.SCALAR:
            return _build(field.cls, value, path)
        if isinstance(value, np.ndarray):
            return value.copy()
        if not isinstance(value, (list, tuple)):
            raise EncodeError(path, f"expected a list of {kind.base}, found {short_repr(value)}")
        return [_build(field.cls, item, f"{path}[{index}]") for index, item in enumerate(value)]
    primitive = kind.primitive
    if primitive is None:
        return list(value) if isinstance(value, tuple) else value
    is_float = DTYPES[primitive.code].kind == "f"
    if kind.arity is Arity.SCALAR:
        return _float(value) if is_float else value
    if is_float and isinstance(value, (list, tuple)):
        value = [_float(item) for item in value]
    try:
        return coerce(value, primitive.code).copy()
    except FieldValueError as error:
        raise EncodeError(path + error.suffix, error.reason) from None


def _float(value: Any) -> Any:
    if isinstance(value, str):
        return _SPECIAL_FLOATS.get(value, value)
    return float(value) if isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**1023 else value
