"""Random and mutated input for every type of the checkout: a value or the right error, in bounded memory.

``--fuzz-rounds N`` runs longer. The seed of a failed run is printed; ROSIDL_TEST_FUZZ_SEED repeats it.
"""

from __future__ import annotations

import json
import os
import random
import tracemalloc
from typing import Any

import decode_target
import pytest
from decode_target import check_against, try_decode
from support.bundled_interfaces import message, message_names, reference, vectors_by_type

from rosidl_py_gen import EncodeError, Message, encode, from_dict, from_json, to_dict, type_name, validate

# Bytes of Python objects for one byte of input: an array of one element is an object of about 120 bytes, and a message
# may consist of such arrays.
BYTES_PER_BYTE = 400
FIXED_BYTES = 200_000

NUMBERS = [
    bytes.fromhex(text) for text in ("ffffffff", "ffffff7f", "00000080", "00000000", "01000000", "00010000", "ff000000")
]


def mutate(rng: random.Random, data: bytes) -> bytes:
    """Return damaged data: flipped bits, odd counts, cuts, insertions, repetitions."""
    raw = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4))):
        place = rng.randrange(len(raw) + 1)
        match rng.randrange(8):
            case 0 if raw:
                raw[place % len(raw)] ^= 1 << rng.randrange(8)
            case 1:
                raw[place:] = b""
            case 2:
                raw[place:place] = rng.randbytes(rng.randrange(1, 9))
            case 3:
                del raw[place : place + rng.randrange(1, 9)]
            case 4 | 5:
                place -= place % 4
                raw[place : place + 4] = rng.choice(NUMBERS)
            case 6:
                raw += raw[place:] * rng.randrange(1, 3)
            case _ if raw:
                raw[place % len(raw)] = rng.choice((0, 1, 0x7F, 0x80, 0xD8, 0xFF))
    return bytes(raw)


class Inputs:
    """An endless stream of (class, bytes); seeded, so that a finding can be repeated."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self.names = message_names()
        known = vectors_by_type()
        oracle = reference()
        self.corpus: dict[str, list[bytes]] = {}
        for name in self.names:
            samples = [vector.cdr for vector in known.get(name, [])] + [encode(message(name)())]
            plain = oracle.decode(name, samples[-1])
            self.corpus[name] = [*samples, oracle.encode(name, plain, big_endian=True)]

    def next(self) -> tuple[type[Message], bytes]:
        rng = self.rng
        name = rng.choice(self.names)
        kind = rng.randrange(10)
        if kind == 0:
            data = rng.randbytes(rng.randrange(64))
        elif kind == 1:
            data = rng.choice((b"\0\1\0\0", b"\0\0\0\0")) + rng.randbytes(rng.randrange(200))
        elif kind == 2:  # bytes of another type
            data = rng.choice(self.corpus[rng.choice(self.names)])
        elif kind == 3:  # mostly small numbers: counts that fit
            data = b"\0\1\0\0" + bytes(rng.choice((0, 0, 0, 0, 1, 2, 3)) for _ in range(rng.randrange(300)))
        else:
            data = mutate(rng, rng.choice(self.corpus[name]))
        return message(name), data


@pytest.fixture
def rounds(pytestconfig: pytest.Config) -> int:
    return int(pytestconfig.getoption("--fuzz-rounds"))


@pytest.fixture
def seed() -> int:
    chosen = int(os.environ.get("ROSIDL_TEST_FUZZ_SEED") or random.SystemRandom().randrange(2**32))
    print(f"fuzz seed {chosen}")
    return chosen


@pytest.mark.timeout(0)
def test_any_bytes_are_decoded_or_raise_decode_error(rounds: int, seed: int) -> None:
    inputs = Inputs(seed)
    values = 0
    for number in range(rounds):
        cls, data = inputs.next()
        found = try_decode(cls, data, copy=number % 4 == 0)
        values += found is not None
    assert rounds // 20 < values < rounds  # both outcomes are really tried


@pytest.mark.timeout(0)
def test_any_bytes_are_decoded_or_refused_like_the_reference(rounds: int, seed: int) -> None:
    inputs = Inputs(seed)
    oracle = reference()
    for _ in range(rounds // 10):
        check_against(oracle, *inputs.next())


@pytest.mark.timeout(0)
def test_memory_of_decoding_is_bounded_by_the_input_size(rounds: int, seed: int) -> None:
    inputs = Inputs(seed)
    for _ in range(rounds // 50):
        check_memory(*inputs.next())


@pytest.mark.parametrize("fill", [b"\1\0\0\0", b"\0\0\0\0", b"\xff\xff\xff\xff", b"\0\1\0\0", b"\0\0\1\0", b"\1"])
def test_memory_is_bounded_if_every_count_is_as_large_as_possible(fill: bytes) -> None:
    for name in message_names():
        for size in (100, 20_000):
            data = b"\0\1\0\0" + (fill * size)[:size]
            check_memory(message(name), data)
            check_memory(message(name), data[:4] + size.to_bytes(4, "little") + data[8:])


def check_memory(cls: type[Message], data: bytes) -> None:
    for arrays in (False, True):
        try_decode(cls, data, arrays=arrays)  # caches made once, such as field tables, do not count
        tracemalloc.start()
        try:
            kept = try_decode(cls, data, arrays=arrays)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert peak <= FIXED_BYTES + BYTES_PER_BYTE * len(data), (type_name(cls), len(data), peak, data[:64].hex())
        del kept


# --- dicts and JSON ---------------------------------------------------------------------------------------------------

SCALARS: list[Any] = [
    *(None, True, False, 0, 1, -1, 255, 256, 2**31, 2**63, 2**64, 10**30, 0.0, -0.5, 1e300, 1e-320),
    *("", "a", "NaN", "Infinity", "-Infinity", "nan", "é", "\ud800", "x" * 1000, "\0"),
]


def random_json(rng: random.Random, depth: int) -> Any:
    kind = rng.randrange(6) if depth else 0
    if kind == 4:
        return [random_json(rng, depth - 1) for _ in range(rng.randrange(4))]
    if kind == 5:
        return {rng.choice(("x", "data", "stamp", "header", "", "pose")): random_json(rng, depth - 1) for _ in range(2)}
    return rng.choice(SCALARS)


def damage(rng: random.Random, value: Any, depth: int = 4) -> Any:
    """Return a valid value with a random mutation."""
    if depth == 0 or rng.randrange(6) == 0:
        return random_json(rng, 2)
    if isinstance(value, dict) and value:
        key = rng.choice(list(value))
        changed = dict(value)
        changed[key] = damage(rng, value[key], depth - 1)
        match rng.randrange(12):
            case 0:
                changed[key + rng.choice("_sx")] = changed.pop(key)
            case 1:
                del changed[key]
        return changed
    if isinstance(value, list) and value:
        place = rng.randrange(len(value))
        return [*value[:place], damage(rng, value[place], depth - 1), *value[place + 1 :]]
    return random_json(rng, 2)


@pytest.mark.timeout(0)
def test_any_dict_or_json_becomes_a_message_or_raises_encode_error(rounds: int, seed: int) -> None:
    rng = random.Random(seed)
    names = message_names()
    samples = {name: [to_dict(message(name)()), *(v.value for v in vectors_by_type().get(name, []))] for name in names}
    outcomes = {True: 0, False: 0}
    for _ in range(rounds // 5):
        name = rng.choice(names)
        cls = message(name)
        values = damage(rng, rng.choice(samples[name]))
        found: Message | None = None
        try:
            found = from_dict(cls, values)
        except EncodeError as error:
            assert error.path.startswith(name)
            assert len(str(error)) < 1000
        try:
            twin: Message | None = from_json(cls, json.dumps(values))
        except EncodeError:
            twin = None
        outcomes[found is not None] += 1
        assert (found is None) == (twin is None)
        if found is not None and twin is not None:
            validate(found)
            assert encode(found) == encode(twin)
    assert min(outcomes.values()) > rounds // 100


@pytest.mark.timeout(0)
def test_any_json_text_becomes_a_message_or_raises_encode_error(rounds: int, seed: int) -> None:
    rng = random.Random(seed)
    names = message_names()
    for _ in range(rounds // 10):
        name = rng.choice(names)
        cls = message(name)
        text = mutate(rng, json.dumps(to_dict(cls()), ensure_ascii=rng.random() < 0.5).encode())
        try:
            found = from_json(cls, text if rng.random() < 0.5 else text.decode("utf-8", "replace"))
        except EncodeError as error:
            assert error.path.startswith(name)
            continue
        assert encode(found)


def test_atheris_target_accepts_any_bytes_without_atheris() -> None:
    for data in (b"", b"\0", b"\0\0", b"\5\0\0\1\0\0", bytes(100), b"\xff" * 100):
        decode_target.one_input(data)
