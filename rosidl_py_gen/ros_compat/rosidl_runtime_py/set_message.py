"""Fields of messages, set from dicts, lists, numbers and texts."""

from __future__ import annotations

import array
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy
from rosidl_parser.definition import AbstractNestedType, NamespacedType

from rosidl_runtime_py.convert import get_message_slot_types
from rosidl_runtime_py.import_message import import_message_from_namespaced_type

_HEADER, _TIME = "std_msgs.msg._header.Header", "builtin_interfaces.msg._time.Time"


def set_message_fields(
    msg: Any, values: dict[str, Any], expand_header_auto: bool = False, expand_time_now: bool = False
) -> list[Any]:
    """Set the fields that `values` names, in messages inside of messages as well.

    Args:
        expand_header_auto: ``auto`` for a Header leaves it, and its stamp to be set later.
        expand_time_now: ``now`` for a Time leaves it to be set later.

    Returns:
        A function for each time that is left; it takes the `Time` to be set.

    Raises:
        AttributeError: there is no such field.
        TypeError: a value that does not fit its field, or no dict where fields are expected.
    """
    left: list[Callable[[Any], None]] = []
    _set(msg, values, expand_header_auto, expand_time_now, left)
    return left


def _set(msg: Any, values: Any, header: bool, now: bool, left: list[Callable[[Any], None]]) -> None:
    if not hasattr(values, "items"):
        text = f"Value '{values}' is expected to be a dictionary but is a {type(values).__name__}"
        raise TypeError(text)
    types = get_message_slot_types(msg)
    for name, given in values.items():
        field = getattr(msg, name)
        kind = type(field)
        full_name = f"{kind.__module__}.{kind.__name__}"
        value: Any
        if kind is array.array:
            value = array.array(field.typecode, given)
        elif kind is numpy.ndarray:
            value = numpy.array(given, dtype=field.dtype)
        elif type(given) is kind:
            value = given
        elif header and full_name == _HEADER and given == "auto":
            left.append(partial(setattr, field, "stamp"))
            continue
        elif now and full_name == _TIME and given == "now":
            left.append(partial(setattr, msg, name))
            continue
        else:
            try:
                value = kind(given)
            except TypeError:  # a message takes no argument without a name
                value = kind()
                _set(value, given, header, now, left)
        slot = types[name]
        if isinstance(slot, AbstractNestedType) and isinstance(slot.value_type, NamespacedType):
            element = import_message_from_namespaced_type(slot.value_type)
            for index, one in enumerate(value):
                inside = element()
                _set(inside, one, header, now, left)
                value[index] = inside
        setattr(msg, name, value)
