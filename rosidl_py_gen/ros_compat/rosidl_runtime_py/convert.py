"""Conversion of messages to YAML, comma-separated values (CSV) and dicts."""

from __future__ import annotations

import array
import sys
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import numpy
import yaml
from rosidl_parser import definition


class _Dumper(yaml.Dumper):
    """YAML dumper that keeps fields in the order of the message definition."""


_Dumper.add_representer(
    OrderedDict,
    lambda dumper, data: yaml.MappingNode(
        "tag:yaml.org,2002:map",
        [(dumper.represent_data(name), dumper.represent_data(value)) for name, value in data.items()],
    ),
)


@dataclass(frozen=True)
class _Limits:
    """Options that shorten the values of a message when it is converted to text.

    Attributes:
        length: maximum number of elements or characters; None: unlimited.
        no_arr: replace arrays by a text about their type.
        no_str: replace strings by a text about their length.
        is_csv: convert bytes, and numbers of numpy, to texts.
    """

    length: int | None
    no_arr: bool
    no_str: bool
    is_csv: bool = False

    def is_too_long(self, value: Any) -> bool:
        return self.length is not None and len(value) > self.length


def message_to_yaml(
    msg: Any,
    *,
    truncate_length: int | None = None,
    no_arr: bool = False,
    no_str: bool = False,
    flow_style: bool = False,
) -> str:
    """Return a message as YAML, in one line with `flow_style`; other arguments as for `message_to_ordereddict`."""
    plain = message_to_ordereddict(msg, truncate_length=truncate_length, no_arr=no_arr, no_str=no_str)
    text: str = yaml.dump(plain, Dumper=_Dumper, allow_unicode=True, width=sys.maxsize, default_flow_style=flow_style)
    return text


def message_to_ordereddict(
    msg: Any, *, truncate_length: int | None = None, no_arr: bool = False, no_str: bool = False
) -> OrderedDict[str, Any]:
    """Return a message as dicts, lists, numbers and strings, in the order of its fields.

    Args:
        truncate_length: maximum length of arrays and strings; longer ones are cut and end with ``...``.
        no_arr: replace arrays by a text about their type.
        no_str: replace strings by a text about their length.
    """
    return _to_dict(msg, _Limits(truncate_length, no_arr, no_str))


def message_to_csv(msg: Any, *, truncate_length: int | None = None, no_arr: bool = False, no_str: bool = False) -> str:
    """Return the values of a message, separated by commas; arguments as for `message_to_ordereddict`."""
    return _join(_to_dict(msg, _Limits(truncate_length, no_arr, no_str, is_csv=True)))


def get_message_slot_types(msg: Any) -> OrderedDict[str, Any]:
    """Return a dict from field name to the type of the field, which is an object of `rosidl_parser`."""
    return OrderedDict(zip(msg.get_fields_and_field_types(), msg.SLOT_TYPES, strict=True))


def _to_dict(msg: Any, limits: _Limits) -> OrderedDict[str, Any]:
    types = get_message_slot_types(msg)
    return OrderedDict((name, _to_plain(getattr(msg, name, None), kind, limits)) for name, kind in types.items())


def _to_plain(value: Any, kind: Any, limits: _Limits) -> Any:
    match value:
        case bytes() if limits.is_csv:
            return str(value[: limits.length] + b"..." if limits.is_too_long(value) else value)
        case bytes():
            text = value[: limits.length].decode("latin-1")
            return f"{text}..." if limits.is_too_long(value) else text
        case str():
            return _shorten_text(value, limits)
        case list() | tuple() | array.array() | numpy.ndarray():
            if limits.no_arr and kind is not None:
                return _array_type_text(value, kind)
            list_class: type[list[Any]] | type[tuple[Any, ...]] = tuple if isinstance(value, tuple) else list
            items = [
                _to_plain(item, None, limits)
                for item in (value[: limits.length] if limits.is_too_long(value) else value)
            ]
            return list_class([*items, "..."] if limits.is_too_long(value) else items)
        case dict():
            unlimited = _Limits(None, False, False)
            return {_to_plain(name, None, unlimited): _to_plain(item, None, limits) for name, item in value.items()}
        case numpy.number():
            return str(value) if limits.is_csv else value.item()
        case bool() | float() | int():
            return value
    return _to_dict(value, limits)


def _join(value: Any) -> str:
    """Return the texts of a value and of all values in it, separated by commas."""
    if isinstance(value, list | tuple | dict):
        return ",".join(map(_join, value.values() if isinstance(value, dict) else value))
    return str(value)


def _shorten_text(text: str, limits: _Limits) -> str:
    if limits.no_str:
        return f"<string length: <{len(text)}>>"
    return f"{text[: limits.length]}..." if limits.is_too_long(text) else text


def _array_type_text(value: Any, kind: Any) -> str:
    if not isinstance(kind, definition.AbstractNestedType):
        return "unknown"
    name = _type_name(kind.value_type)
    if isinstance(kind, definition.Array):
        return f"<array type: {name}[{kind.size}]>"
    if isinstance(kind, definition.BoundedSequence):
        return f"<sequence type: {name}[{kind.maximum_size}], length: {len(value)}>"
    return f"<sequence type: {name}, length: {len(value)}>"


def _type_name(kind: Any) -> str:
    match kind:
        case definition.BasicType():
            return str(kind.typename)
        case definition.AbstractString():
            return "string"
        case definition.AbstractWString():
            return "wstring"
        case definition.NamedType():
            return str(kind.name)
        case definition.NamespacedType():
            return "/".join(kind.namespaced_name())
    return "unknown"
