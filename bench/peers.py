"""The other libraries of bench/codec.py, each as a pair of calls for one message."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from rosidl_py_gen import Message, to_dict, type_name
from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.base.names import RosName, split_ros_name
from rosidl_py_gen.compiler.frontend.definition_text import full_text
from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.compiler.generate import load

Pair = tuple[Callable[[], Any], Callable[[], Any]]


@dataclass
class Peer:
    """A library by name; `make` gives its encode and decode calls for a message, or None if it cannot."""

    name: str
    make: Callable[[Message, bytes], Pair | None]

    def pair(self, message: Message, payload: bytes) -> Pair | None:
        return self.make(message, payload)


def available_peers() -> list[Peer]:
    """The peers that are installed. The last three are not in the test extra: install them by hand."""
    known: list[tuple[str, str, Callable[[Message, bytes], Pair | None]]] = [
        ("rosbags", "rosbags", _rosbags),
        ("pycdr2", "pycdr2", _pycdr2),
        ("mcap_ros2", "mcap-ros2-support", _mcap),
        ("mcap_ros2_support_fast", "mcap-ros2-support-fast", _mcap_fast),
        ("cyclonedds_idl", "ros2-pyterfaces[cyclone]", partial(_pyterfaces, "cyclone")),
        ("cydr", "ros2-pyterfaces[cydr]", partial(_pyterfaces, "cydr")),  # compiles C at a type's first use
    ]
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
    text = _text(name)
    short = f"{name.package}/{name.name}"
    decoder = next(value for key, value in generate_dynamic(short, text).items() if key in (short, str(name)))
    encoder = next(value for key, value in serialize_dynamic(short, text).items() if key in (short, str(name)))
    value = _lists(to_dict(message))
    assert encoder(value) == payload
    return lambda: encoder(value), lambda: decoder(payload)


def _mcap_fast(message: Message, payload: bytes) -> Pair:
    from mcap_ros2_support_fast import DecoderFactory, ROS2EncoderFactory

    name = split_ros_name(type_name(message))
    schema = SimpleNamespace(id=1, name=str(name), encoding="ros2msg", data=_text(name).encode())
    decoder, encoder = DecoderFactory().decoder_for("cdr", schema), ROS2EncoderFactory().encoder_for(schema)
    assert decoder is not None and encoder is not None
    value = to_dict(message)  # of what it decodes itself, it does not encode arrays of floats
    assert bytes(encoder(value)) == payload
    return lambda: encoder(value), lambda: decoder(payload)


def _pyterfaces(backend: str, message: Message, payload: bytes) -> Pair | None:
    package, kind, name = split_ros_name(type_name(message))
    try:
        cls = getattr(importlib.import_module(f"ros2_pyterfaces.{backend}.{package}.{kind}"), name)
    except ModuleNotFoundError:
        return None  # it has no tf2_msgs
    if hasattr(cls, "__unsupported_reason__"):
        return None  # cydr has no sequences of messages; such a class is empty
    value = cls.deserialize(payload)
    assert bytes(value.serialize())[: len(payload)] == payload
    return value.serialize, lambda: cls.deserialize(payload)


def _text(name: RosName) -> str:
    library, _ = load(scan_search_path(), [str(name)])
    return full_text(library, name)


def _lists(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value
