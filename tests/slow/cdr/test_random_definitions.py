"""Random definitions and values, against the reference implementation."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from support.definition_strategies import World, values, worlds
from support.example_counts import examples
from support.reference_cdr import Reference, ReferenceError, same

from rosidl_py_gen import (
    DecodeError,
    Message,
    decode,
    encode,
    from_dict,
    from_json,
    to_dict,
    to_json,
    type_name,
    validate,
)
from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.base.names import py_name


@st.composite
def worlds_and_values(draw: st.DrawFn) -> tuple[World, Reference, dict[str, Any]]:
    world = draw(worlds())
    reference = world.reference()
    return world, reference, draw(values(reference, world.top))


def garbage(seed: int) -> Any:
    return random.Random(seed).randbytes


@settings(max_examples=examples(600))
@given(worlds_and_values())
def test_encoded_bytes_equal_the_reference_implementation(case: tuple[World, Reference, dict[str, Any]]) -> None:
    world, reference, value = case
    message = reference.build(world.compile(), value)
    validate(message)
    assert encode(message).hex() == reference.encode(world.top, value).hex()


@settings(max_examples=examples(600))
@given(worlds_and_values(), st.integers(0, 2**32), st.binary(max_size=9))
def test_every_byte_order_with_garbage_in_padding_decodes_to_the_value(
    case: tuple[World, Reference, dict[str, Any]], seed: int, behind: bytes
) -> None:
    world, reference, value = case
    cls = world.compile()
    for big_endian in (False, True):
        data = reference.encode(world.top, value, big_endian=big_endian, pad=garbage(seed)) + behind
        for copy in (False, True):
            message = decode(cls, data, copy=copy)
            assert type(message) is cls
            assert same(reference.plain(message), value)
            _check_arrays(message, reference, writeable=copy)
        assert same(reference.plain(decode(cls, memoryview(bytearray(data)))), value)
        assert same(reference.decode(world.top, data), value)


def _check_arrays(message: Message, reference: Reference, writeable: bool) -> None:
    """Check that numeric arrays have the annotated dtype in native order, one dimension, and `writeable`."""
    for item in reference.definition(type_name(message)).fields:
        held = getattr(message, py_name(item.name))
        if item.type.arity is Arity.SCALAR:
            if item.type.is_message:
                _check_arrays(held, reference, writeable)
            elif item.type.primitive is not None:
                assert type(held).__name__ == item.type.primitive.python
            continue
        if item.type.primitive is None:
            assert type(held) is list
            for one in held if item.type.is_message else ():
                _check_arrays(one, reference, writeable)
            continue
        assert held.ndim == 1
        assert held.dtype == np.dtype(item.type.primitive.numpy)
        assert held.dtype.isnative
        if len(held):
            assert held.flags.writeable == writeable


@settings(max_examples=examples(300))
@given(worlds_and_values())
def test_dicts_and_json_round_trip_every_value(case: tuple[World, Reference, dict[str, Any]]) -> None:
    world, reference, value = case
    cls = world.compile()
    message = reference.build(cls, value)
    wire = encode(message)
    assert same(to_dict(decode(cls, wire)), value)
    assert same(to_dict(message), value)
    assert encode(from_dict(cls, value)) == wire
    assert same(to_dict(from_json(cls, to_json(message))), value)
    assert "NaN," not in to_json(message).replace('"NaN"', "")


@settings(max_examples=examples(300))
@given(worlds())
def test_new_message_contains_zeros_and_the_defaults_of_its_definition(world: World) -> None:
    reference = world.reference()
    found = reference.plain(world.compile()())
    defaults = dict(world.defaults)
    for item in reference.definition(world.top).fields:
        if item.name in defaults:
            assert same(found[item.name], _as_stored(item.type, defaults[item.name])), item.name
        elif not item.type.is_message:
            assert same(found[item.name], _zero(item.type)), item.name
    assert same(reference.decode(world.top, reference.encode(world.top, found)), found)


def _as_stored(kind: FieldType, value: Any) -> Any:
    if kind.base.startswith("float"):
        return [float(item) for item in value] if isinstance(value, list) else float(value)
    return value


def _zero(kind: FieldType) -> Any:
    one: Any = (
        "" if kind.is_string else {"bool": False, "float": 0.0}.get(kind.primitive.python if kind.primitive else "", 0)
    )
    if kind.arity is Arity.SCALAR:
        return one
    return [one] * (kind.capacity if kind.arity is Arity.ARRAY else 0)


@settings(max_examples=examples(300))
@given(worlds_and_values(), st.data())
def test_damaged_bytes_are_decoded_or_refused_like_the_reference(
    case: tuple[World, Reference, dict[str, Any]], data: st.DataObject
) -> None:
    """Bytes are cut, overwritten and inserted; both decoders return an equal value, or both refuse."""
    world, reference, value = case
    cls = world.compile()
    wire = bytearray(reference.encode(world.top, value))
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(4, max(4, len(wire) - 1)))
        wire[place : place + 1] = data.draw(st.sampled_from((b"\xff", b"\0", b"\1", b"", b"\0\0", b"\x80")))
    raw = bytes(wire[: data.draw(st.integers(4, len(wire)))]) if data.draw(st.booleans()) else bytes(wire)
    try:
        wanted = reference.decode(world.top, raw)
    except ReferenceError:
        wanted = None
    try:
        found = reference.plain(decode(cls, raw))
    except DecodeError as error:
        assert "cannot be decoded" not in str(error)
        found = None
    assert same(found, wanted)
