"""Decoder factory for readers of the package `mcap`, with the classes of this library."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from mcap.decoder import DecoderFactory as McapDecoderFactory

from rosidl_py_gen import Message, compile_definition, decode
from rosidl_py_gen.errors import DefinitionError, Diagnostic, InvalidNameError

if TYPE_CHECKING:
    from collections.abc import Callable

    from mcap.records import Schema

ENCODINGS = ("ros2msg", "ros2idl")
_HEADER_BYTES = 4


class DecoderFactory(McapDecoderFactory):
    """Decoder factory for ``mcap.reader.make_reader(stream, decoder_factories=[DecoderFactory()])``.

    Replaces ``mcap_ros2.decoder.DecoderFactory``: messages have the same attributes, and are of the generated class if
    one with this definition is importable. Schemas may be ``ros2msg`` or ``ros2idl``.

    Args:
        arrays: sequences of fixed-size messages become structured arrays, as in `decode`.
    """

    def __init__(self, *, arrays: bool = False) -> None:
        self._arrays = arrays
        self._decoders: dict[tuple[str, bytes], Callable[[bytes], Any]] = {}

    def decoder_for(self, message_encoding: str, schema: Schema | None) -> Callable[[bytes], Any] | None:
        """Return the decoder of a schema; None if it is not a schema of ROS 2.

        Raises:
            DefinitionError: the schema's text is invalid.
        """
        if message_encoding != "cdr" or schema is None or schema.encoding not in ENCODINGS:
            return None
        key = schema.name, schema.data
        if key not in self._decoders:
            self._decoders[key] = decoder_of(message_class(schema.name, schema.data), self._arrays)
        return self._decoders[key]


def decoder_of(cls: type[Any], arrays: bool) -> Callable[[bytes | memoryview], Any]:
    """Return `decode` of a class; the function itself, as a wrapper costs as much as decoding a small message."""
    if not cls._TYPE.fields:
        return partial(_decode_empty, cls)
    if any(field.py_name == "decode" for field in cls._TYPE.fields):  # the field has taken the method's place
        return partial(decode, cls, arrays=arrays)
    return partial(cls.decode, arrays=True) if arrays else cls.decode


def _decode_empty(cls: type[Any], data: bytes | memoryview) -> Any:
    """Decode an empty message: ROS writes one byte for it, other writers none."""
    return cls.decode(bytes(data) + b"\0" if len(data) == _HEADER_BYTES else data)


def message_class(name: str, definition: bytes) -> type[Any]:
    """Return the class of a message's schema; raises `DefinitionError`."""
    try:
        cls = compile_definition(name, definition.decode())
    except (UnicodeDecodeError, InvalidNameError) as error:
        raise DefinitionError(Diagnostic(f"<{name[:100]}>", 0, 0, f"the schema cannot be read: {error}")) from None
    if not issubclass(cls, Message):
        text = "the schema is that of a service or action, expected that of a message"
        raise DefinitionError(Diagnostic(f"<{name[:100]}>", 0, 0, text))
    return cls
