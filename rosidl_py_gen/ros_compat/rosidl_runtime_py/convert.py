"""Conversion of messages to YAML, comma-separated values and dicts."""

from __future__ import annotations

import array
import sys
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import numpy
import yaml
from rosidl_parser import definition

_COLLECTIONS = (list, tuple, array.array, numpy.ndarray)


class _Dumper(yaml.Dumper):
    """YAML dumper that retains the order of fields."""


_Dumper.add_representer(
    OrderedDict,
    lambda dumper, data: yaml.MappingNode(
        "tag:yaml.org,2002:map",
        [(dumper.represent_data(name), dumper.represent_data(value)) for name, value in data.items()],
    ),
)


@dataclass(frozen=True)
class _Shortening:
    """Options that shorten values: maximum number of elements or characters, and types in place of values."""

    length: int | None
    no_arr: bool
    no_str: bool

    def cuts(self, value: Any) -> bool:
        return self.length is not None and len(value) > self.length


def message_to_yaml(
    msg: Any,
    *,
    truncate_length: int | None = None,
    no_arr: bool = False,
    no_str: bool = False,
    flow_style: bool = False,
) -> str:
    """Return a message as YAML, in blocks or in one line; see `message_to_ordereddict` for the other arguments."""
    plain = message_to_ordereddict(msg, truncate_length=truncate_length, no_arr=no_arr, no_str=no_str)
    text: str = yaml.dump(plain, Dumper=_Dumper, allow_unicode=True, width=sys.maxsize, default_flow_style=flow_style)
    return text


def message_to_ordereddict(
    msg: Any, *, truncate_length: int | None = None, no_arr: bool = False, no_str: bool = False
) -> OrderedDict[str, Any]:
    """Return a message as dicts, lists, numbers and texts, in the order of its fields.

    Args:
        truncate_length: maximum length of arrays and texts, after which they end in ``...``.
        no_arr: describe the types of arrays in place of their elements.
        no_str: describe the lengths of texts in place of their contents.
    """
    return _dict(msg, _Shortening(truncate_length, no_arr, no_str))


def message_to_csv(msg: Any, *, truncate_length: int | None = None, no_arr: bool = False, no_str: bool = False) -> str:
    """Return the values of a message, separated by commas; see `message_to_ordereddict` for the arguments."""
    short = _Shortening(truncate_length, no_arr, no_str)
    return ",".join(_csv(getattr(msg, name), kind, short) for name, kind in get_message_slot_types(msg).items())


def get_message_slot_types(msg: Any) -> OrderedDict[str, Any]:
    """Return the type of each field, as an object of `rosidl_parser`."""
    return OrderedDict(zip(msg.get_fields_and_field_types(), msg.SLOT_TYPES, strict=True))


def _dict(msg: Any, short: _Shortening) -> OrderedDict[str, Any]:
    types = get_message_slot_types(msg)
    return OrderedDict((name, _plain(getattr(msg, name, None), kind, short)) for name, kind in types.items())


def _plain(value: Any, kind: Any, short: _Shortening) -> Any:
    match value:
        case bytes():
            text = value[: short.length].decode("latin-1")
            return f"{text}..." if short.cuts(value) else text
        case str():
            return _shortened(value, short)
        case list() | tuple() | array.array() | numpy.ndarray():
            if short.no_arr and kind is not None:
                return _array_type_text(value, kind)
            list_class: type[list[Any]] | type[tuple[Any, ...]] = tuple if isinstance(value, tuple) else list
            items = [_plain(item, None, short) for item in (value[: short.length] if short.cuts(value) else value)]
            return list_class([*items, "..."] if short.cuts(value) else items)
        case dict():
            unlimited = _Shortening(None, False, False)
            return {_plain(name, None, unlimited): _plain(item, None, short) for name, item in value.items()}
        case numpy.number():
            return value.item()
        case bool() | float() | int():
            return value
    return _dict(value, short)


def _csv(value: Any, kind: Any, short: _Shortening) -> str:
    if isinstance(value, _COLLECTIONS):
        if short.no_arr and kind is not None:
            return _array_type_text(value, kind)
        texts = [_csv(item, None, short) for item in (value[: short.length] if short.cuts(value) else value)]
        return ",".join(texts) + ((",..." if texts else "...") if short.cuts(value) else "")
    if isinstance(value, str):
        return _shortened(value, short)
    if isinstance(value, bytes):
        return str(value[: short.length] + b"..." if short.cuts(value) else value)
    if isinstance(value, bool | float | int | numpy.number):
        return str(value)
    return ",".join(_csv(getattr(value, name), kind, short) for name, kind in get_message_slot_types(value).items())


def _shortened(text: str, short: _Shortening) -> str:
    if short.no_str:
        return f"<string length: <{len(text)}>>"
    return f"{text[: short.length]}..." if short.cuts(text) else text


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
