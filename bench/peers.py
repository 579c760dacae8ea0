"""The other libraries of bench/codec.py, each as a pair of calls for one message."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rosidl_py_gen import Message, to_dict, type_name
from rosidl_py_gen.cli.interface import full_text
from rosidl_py_gen.fieldtype import Arity
from rosidl_py_gen.generate import load
from rosidl_py_gen.names import split_ros_name
from rosidl_py_gen.spec.find import search_path

Pair = tuple[Callable[[], Any], Callable[[], Any]]


@dataclass
class Peer:
    """A library by name; `make` gives its encode and decode calls for a message, or None if it cannot."""

    name: str
    make: Callable[[Message, bytes], Pair | None]

    def pair(self, message: Message, payload: bytes) -> Pair | None:
        return self.make(message, payload)


def available_peers() -> list[Peer]:
    """The peers that are installed."""
    known = [("rosbags", "rosbags", _rosbags), ("pycdr2", "pycdr2", _pycdr2), ("mcap_ros2", "mcap-ros2-support", _mcap)]
    return [Peer(name, make) for module, name, make in known if importlib.util.find_spec(module)]


_stores: list[Any] = []


def _rosbags(message: Message, payload: bytes) -> Pair:
    from rosbags.typesys import Stores, get_typestore

    if not _stores:
        _stores.append(get_typestore(Stores.ROS2_JAZZY))
    store = _stores[0]
    name = type_name(message)
    value = store.deserialize_cdr(payload, name)
    assert bytes(store.serialize_cdr(value, name))[: len(payload)] == payload
    return lambda: store.serialize_cdr(value, name), lambda: store.deserialize_cdr(payload, name)


def _pycdr2(message: Message, payload: bytes) -> Pair | None:
    cls = _pycdr2_class(type(message), {})
    value = cls.deserialize(payload)
    assert value.serialize() == payload
    return value.serialize, lambda: cls.deserialize(payload)


def _pycdr2_class(cls: type[Message], known: dict[type[Message], Any]) -> Any:
    from pycdr2 import IdlStruct
    from pycdr2 import types as idl

    if cls in known:
        return known[cls]
    scalars = {"string": str, "bool": bool, "byte": idl.uint8, "char": idl.uint8}
    members = []
    for field in cls._TYPE.fields:
        base = _pycdr2_class(field.cls, known) if field.cls else scalars.get(field.type.base)
        base = base or getattr(idl, field.type.base)
        if field.type.arity is Arity.ARRAY:
            base = idl.array[base, field.type.capacity]
        elif field.type.arity is not Arity.SCALAR:
            base = idl.sequence[base]
        members.append((field.ros_name, base))

    known[cls] = dataclass(type(cls.__name__, (IdlStruct,), {"__annotations__": dict(members)}, typename=cls.__name__))

    return known[cls]


def _mcap(message: Message, payload: bytes) -> Pair:
    from mcap_ros2._dynamic import generate_dynamic, serialize_dynamic

    name = split_ros_name(type_name(message))
    library, _ = load(search_path(), [str(name)])
    text = full_text(library, name)
    short = f"{name.package}/{name.name}"
    decoder = next(value for key, value in generate_dynamic(short, text).items() if key in (short, str(name)))
    encoder = next(value for key, value in serialize_dynamic(short, text).items() if key in (short, str(name)))
    value = _lists(to_dict(message))
    assert encoder(value) == payload
    return lambda: encoder(value), lambda: decoder(payload)


def _lists(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value
