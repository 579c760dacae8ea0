"""Structured arrays of random fixed-size definitions, against the reference implementation."""

from __future__ import annotations

import copy
import hashlib
import pickle
import random
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.definition_strategies import World, values
from support.example_counts import examples
from support.inner_state import type_fields
from support.reference_cdr import NUMBERS, Reference, same

from rosidl_py_gen import (
    DecodeError,
    Message,
    decode,
    dtype,
    encode,
    from_dict,
    from_json,
    messages,
    records,
    to_dict,
    to_json,
    type_name,
    validate,
)
from rosidl_py_gen.base.fieldtype import Arity

NAMES = ("x", "from", "data", "arrays", "view", "values", "pos", "ndarray", "append", "self", "y:z")
KINDS = tuple(NUMBERS)


@st.composite
def fixed_bodies(draw: st.DrawFn, earlier: list[str]) -> list[str]:
    """Draw the fields of a fixed-size message; sometimes none, or too many for inline code."""
    lines = []
    for index in range(draw(st.sampled_from((0, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 50)))):
        nested = earlier and draw(st.integers(0, 2)) == 2
        base = draw(st.sampled_from(earlier if nested else KINDS))
        count = draw(st.sampled_from(("", "", "[1]", "[2]", "[3]")))
        lines.append(f"{base}{count if index < 4 else ''} {NAMES[index] if index < 4 else f'more_{index}'}")
    return lines[:4] if any(line.startswith("Fixed") for line in lines[4:]) else lines


@st.composite
def record_worlds(draw: st.DrawFn) -> World:
    """Draw fixed-size messages, a message with them after strings of odd length, and a message that contains it."""
    fixed: list[str] = []
    bodies: list[tuple[str, list[str]]] = []
    for number in range(draw(st.integers(1, 3))):
        bodies.append((f"Fixed{number}", draw(fixed_bodies(fixed))))
        fixed.append(f"Fixed{number}")
    holder = []
    for name in draw(st.permutations(("items", "arrays", "view", "more"))):
        holder += [draw(st.sampled_from(("string lead_{}", "uint8 lead_{}", "float64 lead_{}"))).format(name)]
        count = draw(st.sampled_from(("[]", "[]", "[<=3]", "[2]", "[1]", "")))
        holder.append(f"{draw(st.sampled_from(fixed))}{count} {name}")
    bodies.append(("Holder", holder))
    count = draw(st.sampled_from(("", "[]", "[2]")))
    bodies.append(("Top", [f"Holder{count} held", "string between", *holder[: draw(st.integers(0, 8))]]))
    texts = [(name, "".join(f"{line}\n" for line in lines)) for name, lines in bodies]
    package = "r" + hashlib.sha256(repr(texts).encode()).hexdigest()[:16]
    return World(tuple((f"{package}/msg/{name}", text) for name, text in texts), ())


@st.composite
def cases(draw: st.DrawFn) -> tuple[World, Reference, dict[str, Any]]:
    world = draw(record_worlds())
    reference = world.reference()
    return world, reference, draw(values(reference, world.top))


Case = tuple[World, Reference, dict[str, Any]]


def arrays_in(message: Message) -> list[tuple[type[Message], np.ndarray[Any, Any]]]:
    """Return every structured array with the class of its elements, also inside lists of messages."""
    found = []
    for field in type_fields(message):
        held = getattr(message, field.py_name)
        if field.cls is None:
            continue
        if isinstance(held, np.ndarray):
            found.append((field.cls, held))
        else:
            for one in held if isinstance(held, list) else [held]:
                found += arrays_in(one)
    return found


def lists_in(message: Message) -> list[str]:
    """Return the names of fields at any depth that are lists of fixed-size messages."""
    found = []
    for field in type_fields(message):
        held = getattr(message, field.py_name)
        if field.cls is None or isinstance(held, np.ndarray):
            continue
        if isinstance(held, list) and "Fixed" in type_name(field.cls):
            found.append(field.ros_name)
        if not type_name(field.cls).endswith(("Fixed0", "Fixed1", "Fixed2")):
            for one in held if isinstance(held, list) else [held]:
                found += lists_in(one)
    return found


def with_arrays(message: Message, change: Any = lambda array: array) -> Message:
    """Return a copy with structured arrays instead of all lists of fixed-size messages."""
    clone = copy.copy(message)
    for field in type_fields(message):
        held = getattr(message, field.py_name)
        if field.cls is None:
            continue
        if isinstance(held, list):
            fixed = "Fixed" in type_name(field.cls)
            new: Any = change(records(held, field.cls)) if fixed else [with_arrays(one, change) for one in held]
        else:
            new = with_arrays(held, change)
        setattr(clone, field.py_name, new)
    return clone


@pytest.mark.slow
@settings(max_examples=examples(150))
@given(cases(), st.integers(0, 2**32), st.binary(max_size=9))
def test_structured_arrays_decode_to_the_values_of_the_reference(case: Case, seed: int, behind: bytes) -> None:
    world, reference, value = case
    cls = world.compile()
    plain = reference.encode(world.top, value)
    for big_endian in (False, True):
        data = reference.encode(world.top, value, big_endian=big_endian, pad=random.Random(seed).randbytes) + behind
        for own in (False, True):
            message = decode(cls, data, arrays=True, copy=own)
            assert same(reference.plain(message), value)
            assert lists_in(message) == []
            for inner, array in arrays_in(message):
                assert array.dtype == dtype(inner)
                assert array.ndim == 1
                assert array.flags.writeable == own or not len(array)
            assert encode(message).hex() == plain.hex()
            assert "nan" in repr(value) or message == decode(cls, data)
        assert same(reference.plain(decode(cls, memoryview(bytearray(data)), arrays=True)), value)


@settings(max_examples=examples(40))
@given(cases())
def test_writing_into_a_copied_structured_array_changes_no_other_array(case: Case) -> None:
    world, reference, value = case
    message = decode(world.compile(), reference.encode(world.top, value), arrays=True, copy=True)
    arrays = [array for _, array in arrays_in(message) if len(array)]
    for index, array in enumerate(arrays):
        others = [pickle.dumps(other) for other in arrays[index + 1 :]]
        array[...] = np.zeros(len(array), array.dtype)
        assert [pickle.dumps(other) for other in arrays[index + 1 :]] == others


@settings(max_examples=examples(30))
@given(cases())
def test_bytes_cut_at_any_length_are_refused_for_structured_arrays(case: Case) -> None:
    world, reference, value = case
    cls = world.compile()
    for big_endian in (False, True):
        data = reference.encode(world.top, value, big_endian=big_endian)
        for size in {*range(0, len(data), 1 + len(data) // 60), len(data) - 1}:
            with pytest.raises(DecodeError) as caught:
                decode(cls, data[:size], arrays=True)
            assert "cannot be decoded" not in caught.value.reason
            assert caught.value.path.startswith(world.top)
            assert 0 <= caught.value.offset_bytes <= size + 8


def changes(array: np.ndarray[Any, Any]) -> list[np.ndarray[Any, Any]]:
    """Return equal arrays in other layouts: strided, big-endian, without padding, fields in reverse order."""
    spread = np.zeros(2 * len(array), array.dtype)
    spread[::2] = array
    backwards = np.zeros(len(array), reordered(array.dtype))
    assign(backwards, array)
    return [spread[::2], array.astype(array.dtype.newbyteorder(">")), backwards, array[::-1][::-1]]


def reordered(kind: np.dtype[Any]) -> np.dtype[Any]:
    if kind.subdtype is not None:
        return np.dtype((reordered(kind.subdtype[0]), kind.subdtype[1]))
    if kind.fields is None:
        return kind
    return np.dtype([(name, reordered(kind.fields[name][0])) for name in reversed(kind.names or ())] or kind)


def assign(target: np.ndarray[Any, Any], source: np.ndarray[Any, Any]) -> None:
    if not target.dtype.names:
        target[...] = source if target.dtype.names is None else target
        return
    for name in target.dtype.names:
        assign(target[name], source[name])


@settings(max_examples=examples(60))
@given(cases())
def test_structured_arrays_of_any_memory_layout_are_encoded_like_lists(case: Case) -> None:
    world, reference, value = case
    message = reference.build(world.compile(), value)
    wire = reference.encode(world.top, value)
    for number in range(4):
        held = with_arrays(message, lambda array, number=number: changes(array)[number])
        validate(held)
        assert encode(held).hex() == wire.hex()
        assert same(to_dict(held), value)


@settings(max_examples=examples(40))
@given(cases())
def test_garbage_in_the_padding_of_a_dtype_is_not_encoded(case: Case) -> None:
    def soiled(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        dirty = np.frombuffer(bytearray(b"\xaa" * array.nbytes), array.dtype)
        assign(dirty, array)
        return dirty

    world, reference, value = case
    held = with_arrays(reference.build(world.compile(), value), soiled)
    assert encode(held).hex() == reference.encode(world.top, value).hex()


@settings(max_examples=examples(60))
@given(cases())
def test_messages_with_lists_and_structured_arrays_behave_equally(case: Case) -> None:
    world, reference, value = case
    cls = world.compile()
    listed = decode(cls, reference.encode(world.top, value))
    held = decode(cls, reference.encode(world.top, value), arrays=True)
    if "nan" not in repr(value):
        assert held == listed and listed == held
        assert held == pickle.loads(pickle.dumps(held)) == copy.deepcopy(held) == with_arrays(listed)
    assert repr(held) == repr(listed)
    assert to_json(held) == to_json(listed)
    assert same(to_dict(from_json(cls, to_json(held))), value)
    for inner, array in arrays_in(held):
        back = records(messages(inner, array), inner)
        assert back.dtype == dtype(inner)
        assert [encode(one) for one in messages(inner, back)] == [encode(one) for one in messages(inner, array)]


@settings(max_examples=examples(40))
@given(cases())
def test_from_dict_accepts_structured_arrays(case: Case) -> None:
    world, reference, value = case
    cls = world.compile()
    held = decode(cls, reference.encode(world.top, value), arrays=True)
    shallow = {
        field.ros_name: getattr(held, field.py_name)
        for field in type_fields(cls)
        if field.type.arity is not Arity.SCALAR and isinstance(getattr(held, field.py_name), np.ndarray)
    }
    assert encode(from_dict(cls, {**value, **shallow})) == encode(held)
