"""Byte equality with other Python implementations of CDR, for every definition they support."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from pycdr2 import IdlStruct, types
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from support.definition_strategies import World, values, worlds
from support.example_counts import examples
from support.reference_cdr import Reference, same

from rosidl_py_gen import decode, encode
from rosidl_py_gen.base.fieldtype import Arity, FieldType

# --- rosbags: no wstrings; bounds and defaults are read and ignored --------------------------------------------------


@settings(max_examples=examples(200))
@given(worlds(nasty=False, wide=False), st.data())
def test_rosbags_encodes_equal_bytes_and_decodes_bytes_of_this_package(world: World, data: st.DataObject) -> None:
    reference = world.reference()
    value = data.draw(values(reference, world.top))
    cls = world.compile()
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(world.text, world.top))
    ours = encode(reference.build(cls, value))
    theirs = bytes(store.serialize_cdr(_rosbags(store, reference, world.top, value), world.top))
    assert ours.hex() == theirs.hex()
    read = store.deserialize_cdr(ours, world.top)
    assert bytes(store.serialize_cdr(read, world.top)) == ours
    big = bytes(store.serialize_cdr(read, world.top, little_endian=False))
    assert same(reference.plain(decode(cls, big)), value)


def _rosbags(store: Any, reference: Reference, name: str, value: dict[str, Any]) -> Any:
    arguments = []
    for item in reference.definition(name).fields:
        given, kind = value[item.name], item.type
        if kind.is_message and kind.arity is Arity.SCALAR:
            given = _rosbags(store, reference, kind.base, given)
        elif kind.is_message:
            given = [_rosbags(store, reference, kind.base, one) for one in given]
        elif kind.primitive is not None and kind.arity is not Arity.SCALAR:
            given = np.array(given, dtype=kind.primitive.numpy)
        if kind.base == "byte":  # rosbags takes octets for signed
            given = np.array(given, np.uint8).view(np.int8)
            given = given.item() if kind.arity is Arity.SCALAR else given
        arguments.append(given)
    return store.types[name](*arguments)


# --- pycdr2: no wstrings, no empty structs ----------------------------------------------------------------------------

_PYCDR2 = {"bool": bool, "byte": types.uint8, "char": types.uint8, "string": str}


@settings(max_examples=examples(200))
@given(worlds(nasty=False, wide=False, exotic=False), st.data())
def test_pycdr2_encodes_equal_bytes_and_decodes_bytes_of_this_package(world: World, data: st.DataObject) -> None:
    reference = world.reference()
    value = data.draw(values(reference, world.top))
    structs: dict[str, type] = {}
    for name, _ in world.texts:
        fields = [(item.name, _annotation(structs, item.type)) for item in reference.definition(name).fields]
        plain = type(name.replace("/", "_"), (IdlStruct,), {"__annotations__": dict(fields)}, typename=name)  # type: ignore[call-overload]
        structs[name] = dataclasses.dataclass(plain)
    cls = world.compile()
    ours = encode(reference.build(cls, value))
    theirs = _pycdr2(structs, reference, world.top, value).serialize()
    assert ours.hex() == theirs.hex()
    assert structs[world.top].deserialize(ours).serialize() == ours  # type: ignore[attr-defined]


def _annotation(structs: dict[str, type], kind: FieldType) -> Any:
    base: Any = structs.get(kind.base) or _PYCDR2.get(kind.base) or getattr(types, kind.base)
    match kind.arity:
        case Arity.ARRAY:
            return types.array[base, kind.capacity]
        case Arity.BOUNDED:
            return types.sequence[base, kind.capacity]
        case Arity.UNBOUNDED:
            return types.sequence[base]
    return base


def _pycdr2(structs: dict[str, type], reference: Reference, name: str, value: dict[str, Any]) -> Any:
    arguments = {}
    for item in reference.definition(name).fields:
        given, kind = value[item.name], item.type
        if kind.is_message and kind.arity is Arity.SCALAR:
            given = _pycdr2(structs, reference, kind.base, given)
        elif kind.is_message:
            given = [_pycdr2(structs, reference, kind.base, one) for one in given]
        arguments[item.name] = given
    return structs[name](**arguments)
