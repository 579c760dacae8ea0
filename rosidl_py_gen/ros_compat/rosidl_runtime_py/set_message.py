"""Assignment of message fields from dicts, lists, numbers and strings."""

from __future__ import annotations

import array
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy
from rosidl_parser.definition import AbstractNestedType, NamespacedType

from rosidl_runtime_py.convert import get_message_slot_types
from rosidl_runtime_py.import_message import import_message_from_namespaced_type

_HEADER = "std_msgs.msg._header.Header"
_TIME = "builtin_interfaces.msg._time.Time"


def set_message_fields(
    msg: Any, values: dict[str, Any], expand_header_auto: bool = False, expand_time_now: bool = False
) -> list[Any]:
    """Set the fields of a message, and of nested messages, to the values in a dict.

    Args:
        msg: message to change.
        values: dict from field name to value; the value is a dict for a nested message.
        expand_header_auto: accept the value ``auto`` for a Header, whose stamp the caller sets later.
        expand_time_now: accept the value ``now`` for a Time, which the caller sets later.

    Returns:
        A function for each time that the caller must set; the function takes the `Time`.

    Raises:
        AttributeError: a field does not exist.
        TypeError: a value does not fit its field, or is not a dict although fields are expected.
    """
    pending: list[Callable[[Any], None]] = []
    _set_fields(msg, values, expand_header_auto, expand_time_now, pending)
    return pending


def _set_fields(
    msg: Any, values: Any, expand_header: bool, expand_now: bool, pending: list[Callable[[Any], None]]
) -> None:
    if not hasattr(values, "items"):
        text = f"Value '{values}' is expected to be a dictionary but is a {type(values).__name__}"
        raise TypeError(text)
    types = get_message_slot_types(msg)
    for name, new_value in values.items():
        field = getattr(msg, name)
        kind = type(field)
        full_name = f"{kind.__module__}.{kind.__name__}"
        value: Any
        if kind is array.array:
            value = array.array(field.typecode, new_value)
        elif kind is numpy.ndarray:
            value = numpy.array(new_value, dtype=field.dtype)
        elif type(new_value) is kind:
            value = new_value
        elif expand_header and full_name == _HEADER and new_value == "auto":
            pending.append(partial(setattr, field, "stamp"))
            continue
        elif expand_now and full_name == _TIME and new_value == "now":
            pending.append(partial(setattr, msg, name))
            continue
        else:
            try:
                value = kind(new_value)
            except TypeError:  # a message, which takes keyword arguments only
                value = kind()
                _set_fields(value, new_value, expand_header, expand_now, pending)
        slot = types[name]
        if isinstance(slot, AbstractNestedType) and isinstance(slot.value_type, NamespacedType):
            element = import_message_from_namespaced_type(slot.value_type)
            for index, item in enumerate(value):
                message = element()
                _set_fields(message, item, expand_header, expand_now, pending)
                value[index] = message
        setattr(msg, name, value)
