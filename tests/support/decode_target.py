"""Checks of one input for the fuzzers, and an atheris program that repeats them.

Run by hand, with atheris installed::

    PYTHONPATH=tests python tests/support/decode_target.py -max_len=4096 corpus/

The first two bytes of an input choose the message type, the rest is decoded.
"""

from __future__ import annotations

import sys

from rosidl_py_gen import DecodeError, EncodeError, Message, decode, encode, from_json, to_json, type_name
from support.bundled_interfaces import message, message_names, reference
from support.reference_cdr import Reference, ReferenceError, same


def try_decode(cls: type[Message], data: bytes, *, copy: bool = False, arrays: bool = False) -> Message | None:
    """Return the decoded message, or None if the bytes are refused; other exceptions are bugs and propagate."""
    try:
        return decode(cls, data, copy=copy, arrays=arrays)
    except DecodeError as error:
        # This text means that the fast path failed and the slow path did not, which is also a bug.
        assert "cannot be decoded" not in error.reason, error
        assert error.path.startswith(type_name(cls)), error
        assert 0 <= error.offset_bytes <= len(data) + 8, error
        return None


def check_against(oracle: Reference, cls: type[Message], data: bytes) -> bool:
    """Decode with ours and with the reference.

    Both must reject the data, or decode it equally; re-encoding must round-trip.
    """
    found = try_decode(cls, data)
    held = try_decode(cls, data, arrays=True)
    try:
        wanted = oracle.decode(type_name(cls), data)
    except ReferenceError:
        assert found is None and held is None, data.hex()
        return False
    assert found is not None and held is not None, data.hex()
    assert same(oracle.plain(found), wanted), data.hex()
    assert same(oracle.plain(held), wanted), data.hex()
    try:
        again = encode(found)
    except EncodeError as error:  # string bounds are enforced on encode only
        assert "characters" in error.reason, error
        return True
    # Compared as values: the bits of a NaN are kept by arrays, but not by Python floats and JSON.
    assert len(again) == len(oracle.encode(type_name(cls), wanted))
    assert same(oracle.decode(type_name(cls), again), wanted)
    assert same(oracle.decode(type_name(cls), encode(from_json(cls, to_json(found)))), wanted)
    return True


def one_input(data: bytes) -> None:
    """The atheris entry point."""
    names = message_names()
    cls = message(names[int.from_bytes(data[:2], "little") % len(names)])
    check_against(reference(), cls, data[2:])


def main() -> None:
    import atheris  # type: ignore[import-not-found]

    atheris.instrument_all()
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
