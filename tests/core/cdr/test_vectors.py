"""Bytes recorded from rclpy on rmw_cyclonedds: encoded equally, decoded completely or not at all."""

from __future__ import annotations

from random import Random

import pytest
from each_case import each_case
from support.bundled_interfaces import Vector, message, reference, vectors, vectors_by_type
from support.example_counts import examples
from support.reference_cdr import ReferenceError, same

from rosidl_py_gen import DecodeError, decode, encode

BY_TYPE = vectors_by_type()
TYPES = each_case("name", sorted(BY_TYPE))


def test_all_recorded_vectors_are_present() -> None:
    assert len(vectors()) == 1109
    assert len(BY_TYPE) == 278


@TYPES
def test_a_recorded_value_encodes_to_the_recorded_bytes(name: str) -> None:
    oracle = reference()
    for vector in BY_TYPE[name]:
        built = oracle.build(message(name), vector.value)
        assert encode(built).hex() == vector.cdr.hex()
        assert oracle.encode(name, vector.value).hex() == vector.cdr.hex()


@TYPES
def test_recorded_bytes_decode_to_the_recorded_value(name: str) -> None:
    oracle = reference()
    for vector in BY_TYPE[name]:
        wanted = oracle.decode(name, vector.cdr)
        for data in (vector.cdr, bytearray(vector.cdr), memoryview(vector.cdr), vector.cdr + b"\0\0\0"):
            for copy in (False, True):
                assert same(oracle.plain(decode(message(name), data, copy=copy)), wanted)
        _same_as_recorded(vector, wanted)


def _same_as_recorded(vector: Vector, decoded: dict[str, object]) -> None:
    """Compare with JSON, where a float may look like an int; encoding it must yield the same bytes."""
    assert reference().encode(vector.type, decoded) == vector.cdr
    assert decoded == vector.value


@pytest.mark.slow
@TYPES
def test_every_truncation_of_recorded_bytes_is_refused(name: str) -> None:
    """Recorded bytes have no trailing padding, so every byte is needed."""
    oracle, cls = reference(), message(name)
    for vector in BY_TYPE[name]:
        for size in _cuts(vector.cdr):
            cut = vector.cdr[:size]
            if vector is BY_TYPE[name][0]:
                with pytest.raises(ReferenceError):
                    oracle.decode(name, cut)
            for copy in (False, True):
                with pytest.raises(DecodeError) as caught:
                    decode(cls, cut, copy=copy)
                assert "cannot be decoded" not in str(caught.value)
                assert caught.value.offset_bytes <= size + 8
                assert caught.value.path.startswith(name)


def _cuts(data: bytes) -> list[int]:
    """Return all lengths below 128 bytes and near the end, and 64 others, the same in every run."""
    near, far = min(len(data), 128), max(0, len(data) - 16)
    between = range(near, far)
    drawn = Random(data).sample(between, min(examples(64), len(between)))
    return [*range(near), *sorted(drawn), *range(max(near, far), len(data))]
