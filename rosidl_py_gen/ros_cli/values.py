"""Values that users write for messages and parameters, as YAML or JSON, also as documents on standard input.

They are converted to the type that is expected. A number keeps its text until its type is known. So `1e-3`, which YAML
1.1 takes for a text, is a float where a float is expected, and `1.10` is the text "1.10" where a text is expected. The
loader has no integers of YAML 1.1 (`12:30`, `010`, `1_000`): they are texts, which no integer field accepts.

A document is read as soon as it is complete. It ends at a line ``---``, as ``topic echo`` prints it, or at the end of a
line of JSON, as with ``--json``.
"""

from __future__ import annotations

import asyncio
import json
import math
import os
import re
import sys
import threading
from collections.abc import AsyncGenerator
from concurrent.futures import CancelledError
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.base.yaml_text import YamlError, YamlText
from rosidl_py_gen.cdr.arrays import DTYPES
from rosidl_py_gen.command_support import CommandError

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Field, Message

MAX_TEXT = 1 << 20
"""Maximum length of YAML, in characters. Reading it takes some 100 times the memory of the text."""
MAX_JSON = 1 << 28
"""Maximum length of JSON, in characters: `topic echo --json` writes 110 MB for an image of 3840 x 2160 pixels."""
_MAX_DIGITS = 400
"""Maximum number of digits of an integer; the largest float64 has 309."""
_SPECIAL = re.compile(r"([-+]?)\.?(?:(inf|infinity)|nan)\Z", re.IGNORECASE)


class Number(str):
    """Number in a value of the user, as the text that the user wrote."""

    __slots__ = ()

    def plain(self) -> Any:
        """Return the number as int or float, or as text if it is out of range for both."""
        for value in (as_integer(self), as_float(self)):
            if not isinstance(value, str):
                return value
        return str(self)


def parse_value(text: str) -> Any:
    """Return the value of a YAML or JSON text; numbers are `Number`, integers of JSON are int."""
    if len(text) <= MAX_JSON:
        try:
            return json.loads(text, parse_float=Number)
        except (ValueError, RecursionError):
            pass
    if len(text) > MAX_TEXT:
        limits = f"at most {MAX_TEXT} of YAML, or {MAX_JSON} of JSON"
        raise CommandError(f"value: got {len(text)} characters; expected {limits}")
    try:
        return YamlText(text).load(number=Number)
    except YamlError as error:
        raise CommandError(f"not YAML: {error}: {text[:200]!r}") from None


def plain(value: Any) -> Any:
    """Return a parsed value in which each `Number` is replaced by an int or float."""
    if isinstance(value, Number):
        return value.plain()
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list) else value


def as_integer(value: Any) -> Any:
    """Return the int that a `Number` represents, such as `3`, `3.0`, `3e2` or `0xff`.

    Any other value is returned unchanged.
    """
    if not isinstance(value, Number) or _SPECIAL.match(value):
        return value
    digits = value.lstrip("-+")
    if digits[:2] in ("0x", "0b"):
        return int(value, 0)
    try:
        exact = Decimal(value)
        is_integer = abs(exact.adjusted()) < _MAX_DIGITS > len(value) and exact == exact.to_integral_value()
    except ArithmeticError:  # an exponent of 20 digits
        return value
    return int(exact) if is_integer else value


def as_float(value: Any) -> Any:
    """Return the float that a `Number`, or a text such as "NaN" or "-Infinity", stands for.

    Any other value is returned unchanged, also a number that is not within the range of a float64.
    """
    if not isinstance(value, str):
        return value
    if special := _SPECIAL.match(value):
        return math.nan if not special[2] else -math.inf if special[1] == "-" else math.inf
    if not isinstance(value, Number):
        return value
    try:
        number = float(int(value, 0)) if value.lstrip("-+")[:2] in ("0x", "0b") else float(value)
    except OverflowError:
        return value
    return value if math.isinf(number) else number


def as_text(value: Any) -> Any:
    """Return the text of a number; any other value is returned unchanged."""
    is_number = isinstance(value, Number) or (isinstance(value, int | float) and not isinstance(value, bool))
    return str(value) if is_number else value


def as_bool(value: Any) -> Any:
    """Return True or False for 1 or 0; any other value is returned as `as_integer` returns it."""
    number = as_integer(value)
    return bool(number) if type(number) is int and number in (0, 1) else number


def fit(cls: type[Message], values: Any) -> Any:
    """Return parsed values for a message, in which each number is converted to the type of its field.

    Values that do not fit stay unchanged; `from_dict` reports them as errors.
    """
    if not isinstance(values, dict):
        return plain(values)
    fields = {field.ros_name: field for field in cls._TYPE.fields}
    return {key: _fit(fields[key], item) if key in fields else plain(item) for key, item in values.items()}


def _fit(field: Field, value: Any) -> Any:
    kind = field.type
    if field.cls is not None:
        if kind.arity is not Arity.SCALAR and isinstance(value, list):
            return [fit(field.cls, item) for item in value]
        return fit(field.cls, value)
    if kind.primitive is None:
        convert = as_text
    else:
        convert = {"b": as_bool, "f": _as_float_field}.get(DTYPES[kind.primitive.code].kind, _as_integer_field)
    if kind.arity is Arity.SCALAR:
        return _converted(convert(value))
    if not isinstance(value, list):
        return plain(value)
    if convert is _as_integer_field and set(map(type, value)) <= {int}:  # an image: nothing to convert
        return value
    return [_converted(convert(item)) for item in value]


def _as_integer_field(value: Any) -> Any:
    """Return the value for an integer field; a bool is 0 or 1, as in ros2cli."""
    return int(value) if isinstance(value, bool) else as_integer(value)


def _as_float_field(value: Any) -> Any:
    """Return the value for a float field; a bool is 0.0 or 1.0, as in ros2cli."""
    return float(value) if isinstance(value, bool) else as_float(value)


def _converted(value: Any) -> Any:
    """Return a value for `from_dict`.

    A `Number` that could not be converted becomes the text or number that an error displays.
    """
    return plain(value) if isinstance(value, Number | list | dict) else value


_CHUNK_BYTES = 1 << 16
_MAX_QUEUED_CHUNKS = 16


async def documents() -> AsyncGenerator[str, None]:
    """Yield the text of each document that is not empty; raises `CommandError` if it is too long or not UTF-8."""
    lines: list[str] = []
    length = 0
    async for line in _lines():
        if line.startswith(("---", "...")) and not line.strip("-. \t"):
            if lines:
                yield "\n".join(lines) + "\n"
            lines, length = [], 0
        elif not lines and line.startswith("{") and line.endswith("}"):
            yield line
        elif line.strip() or lines:
            lines.append(line)
            length += len(line) + 1
            if length > MAX_TEXT:
                raise CommandError(f"standard input: a document of more than {MAX_TEXT} characters")
    if lines:
        yield "\n".join(lines) + "\n"


async def _lines() -> AsyncGenerator[str, None]:
    incomplete: list[bytes] = []
    length = 0
    async for data in _chunks():
        first, *more = data.split(b"\n")
        incomplete.append(first)
        length += len(first)
        for line in more:
            yield _text(b"".join(incomplete))
            incomplete, length = [line], len(line)
        if length > MAX_JSON:
            raise CommandError(f"standard input: a line of more than {MAX_JSON} bytes")
    if length:
        yield _text(b"".join(incomplete))


def _text(line: bytes) -> str:
    try:
        return line.decode().rstrip("\r")
    except UnicodeDecodeError as error:
        raise CommandError(f"standard input is not UTF-8: {error}") from None


async def _chunks() -> AsyncGenerator[bytes, None]:
    """Yield chunks of bytes from standard input, read by a daemon thread, as an event loop cannot watch a file."""
    if sys.stdin is None or sys.stdin.closed:
        raise CommandError("standard input is closed; expected documents of YAML or JSON there")
    loop, queue = asyncio.get_running_loop(), asyncio.Queue[bytes | OSError](_MAX_QUEUED_CHUNKS)
    file = os.fdopen(os.dup(sys.stdin.fileno()), "rb", buffering=0)  # the thread may read after the command has ended

    def read() -> None:
        data: bytes | OSError = b"?"
        with file:
            while data and isinstance(data, bytes):
                try:
                    data = os.read(file.fileno(), _CHUNK_BYTES)
                except OSError as error:
                    data = error
                enqueue = queue.put(data)
                try:
                    asyncio.run_coroutine_threadsafe(enqueue, loop).result()
                except (RuntimeError, CancelledError):  # the loop is closed, or about to be
                    enqueue.close()
                    return

    threading.Thread(target=read, name="rosidl-py-stdin", daemon=True).start()
    while True:
        data = await queue.get()
        if isinstance(data, OSError):
            raise CommandError(f"standard input: {data.strerror}")
        if not data:
            return
        yield data
