"""Lookup of the message class for each channel of a bag, including bags without definitions (SQLite bags before Iron).

The first of these definitions is used:

1. the definition in the bag;
2. if the bag has a type hash, a definition with this hash;
3. a definition with the name of the type: from the caller, of the distribution that the bag was recorded with,
   importable, on the search path or bundled.

A definition that was found by name is a guess. One warning names it, and the lengths of messages are checked: a message
that is longer or shorter than its fields was written with another definition.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, TypeAlias

from mcap.decoder import DecoderFactory as McapDecoderFactory

from rosidl_py_gen import compile_definition, decode, get_message, type_hash
from rosidl_py_gen.bags.common import BagError, BagTopic, BagWarning
from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.cdr.codec import encoded_length
from rosidl_py_gen.cdr.layout import EMPTY_MESSAGE, Alignment, Header
from rosidl_py_gen.cdr.structured_arrays import varying_field
from rosidl_py_gen.errors import (
    DecodeError,
    DefinitionError,
    Diagnostic,
    InvalidNameError,
    RosidlError,
    UnknownDistributionError,
    printable,
)
from rosidl_py_gen.type_loading import ClassSearch, SearchFolders, definition_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from pathlib import Path

    from mcap.records import Schema

ENCODINGS = ("ros2msg", "ros2idl")
Typestore: TypeAlias = "Mapping[str, type[Message] | str]"
"""Message classes, or definition texts with all types they use, by full type name."""

_CHECK_FIRST_MESSAGES = 20
"""Number of messages at the start of each channel whose length is checked, if the definition was guessed by the type's
name."""
_CHECK_EVERY = 256
"""Distance of later messages whose length is checked, if the definition was guessed by the type's name: one message in
this many. Checking takes up to 45 times as long as decoding. Messages of fixed size are cheap to check, so each of them
is."""
_UNKNOWN_ENCODING = "unknown"
"""Encoding of a definition that rosbag2 states for services whose fields have only primitive types."""
_SERVICE_TEXT = re.compile(r"=+\r?\nSRV: ")
NO_FIELDS = "an empty definition in the bag"
_ADVICE = "pass the folder with the recorded definition (search_path=, --path)"


@dataclass(frozen=True, slots=True)
class TopicDefinition:
    """Definition with which messages of a bag are decoded.

    Attributes:
        message_class: class of the messages.
        origin: ``the bag``, ``an empty definition in the bag``, ``typestore``, a file, a module, ``bundled``, or
            ``bundled (humble)`` with the distribution.
        is_recorded: True if it is the recorded definition: in the bag, or with the recorded hash; False if it was
            guessed by the name of the type.
    """

    message_class: type[Any]
    origin: str
    is_recorded: bool

    @property
    def type_hash(self) -> str:
        """RIHS01 hash of the message class."""
        return type_hash(self.message_class)


class Definitions:
    """Lookup of the message class for each channel of a bag, with a cache.

    Args:
        bag: path of the bag, for warnings.
        search_path: folders with interface packages.
        typestore: classes or definition texts by name, which precede `search_path`.
        hashes: type hashes of ``metadata.yaml``, by topic and type, for files without hashes.
        recorded_distro: returns the distribution of the recorder, or an empty text; called once, if it is needed.

    Raises:
        TypeError: `typestore` contains neither a message class nor a text.
        InvalidNameError: a name in `typestore` is invalid.
    """

    def __init__(
        self,
        bag: Path,
        search_path: SearchFolders,
        typestore: Typestore | None,
        hashes: Mapping[tuple[str, str], str],
        recorded_distro: Callable[[], str] = str,
    ) -> None:
        self._bag = bag
        self._search_path = search_path
        self._typestore: dict[str, type[Message] | str] = {}
        for name, entry in (typestore or {}).items():
            if not isinstance(entry, str) and not (isinstance(entry, type) and issubclass(entry, Message)):
                raise TypeError(f"typestore: {name}: expected a message class or the text of a definition")
            self._typestore[str(RosName.parse(name, "msg"))] = entry
        self._hashes = hashes
        self._recorded_distro = recorded_distro
        self._cache: dict[tuple[str, ...], TopicDefinition] = {}
        self._has_warned = False

    def find(self, topic: BagTopic) -> TopicDefinition:
        """Return the definition of a topic.

        Raises:
            BagError: no definition is known, or none with the recorded hash.
            DefinitionError: the bag's definition is invalid.
        """
        definition = self._cache.get(topic.key)
        if definition is None:
            definition = self._cache[topic.key] = self._find(topic)
        return definition

    def class_of(self, topic: BagTopic) -> type[Any]:
        """Return the message class of a topic; the first guess by name issues a `BagWarning`. Raises as `find`."""
        definition = self.find(topic)
        if not definition.is_recorded and definition.message_class._TYPE.fields and not self._has_warned:
            self._has_warned = True
            text = (
                f"{self._bag}: contains neither definition nor hash of {topic.type_name} ({topic.name}); it is decoded "
                f"as {definition.origin}, which may differ from the recorded definition, as may others; "
                "check with BagReader.definition or `rosidl-py bag info --verbose`, change with search_path= or --path"
            )
            warnings.warn(printable(text), BagWarning, stacklevel=4)
        return definition.message_class

    def _find(self, topic: BagTopic) -> TopicDefinition:
        if topic.message_encoding != "cdr":
            raise BagError(f"{topic.name}: messages are {topic.message_encoding}; expected cdr")
        if has_definition(topic):
            return TopicDefinition(_compiled(topic), "the bag", True)
        recorded_hash = topic.type_hash or self._hashes.get((topic.name, topic.type_name), "")
        try:
            name = str(RosName.parse(topic.type_name, "msg"))
            return self._find_by_hash(topic, name, recorded_hash) if recorded_hash else self._find_by_name(name)
        except RosidlError as error:
            if topic.encoding in ENCODINGS:  # an empty text is the definition of an empty message then
                cls = _compiled(topic)
                if recorded_hash in ("", type_hash(cls)):
                    return TopicDefinition(cls, NO_FIELDS, bool(recorded_hash))
            if isinstance(error, BagError):
                raise
            reason = error.diagnostics[0] if isinstance(error, DefinitionError) else error  # without source lines
            raise BagError(f"{topic.name}: the bag has no definition of {topic.type_name}, and {reason}") from None

    def _find_by_name(self, name: str) -> TopicDefinition:
        cls = self._from_typestore(name)
        if cls is not None:
            return TopicDefinition(cls, "typestore", False)
        distro = self._distro
        cls = get_message(name, path=self._search_path, distro=distro)
        return TopicDefinition(cls, ClassSearch(self._search_path, distro).origin(cls), False)

    @cached_property
    def _distro(self) -> str | None:
        """Distribution with which the bag was recorded.

        Returns None if its definitions are not bundled, or the user selected another distribution.
        """
        if Distribution.selected().is_explicit:
            return None
        try:
            return Distribution.selected(self._recorded_distro()).name
        except UnknownDistributionError:  # an older one, or none is stated
            return None

    def _find_by_hash(self, topic: BagTopic, name: str, recorded_hash: str) -> TopicDefinition:
        """Return the definition whose hash is the recorded type hash.

        Raises `BagError` if every known definition has another hash.
        """
        cls = self._from_typestore(name)
        if cls is not None and type_hash(cls) == recorded_hash:
            return TopicDefinition(cls, "typestore", True)
        search = ClassSearch(self._search_path)
        cls = search.find(name, lambda hashes: hashes[name] == recorded_hash)
        if cls is not None and issubclass(cls, Message):
            return TopicDefinition(cls, search.origin(cls), True)
        other = self._find_by_name(name)
        raise BagError(
            f"{topic.name}: the bag has no definition of {name}, but its hash {recorded_hash}, and {other.origin} has "
            f"{other.type_hash}: {_ADVICE}, or typestore="
        )

    def _from_typestore(self, name: str) -> type[Message] | None:
        entry = self._typestore.get(name)
        return _compiled(BagTopic("typestore", name, entry)) if isinstance(entry, str) else entry


def has_definition(topic: BagTopic) -> bool:
    """Return True if the bag contains a readable definition of the topic."""
    is_service = topic.encoding == _UNKNOWN_ENCODING and _SERVICE_TEXT.match(topic.definition) is not None
    return bool(topic.definition) and (topic.encoding in ENCODINGS or is_service)


def described(topic: BagTopic, definition: TopicDefinition) -> BagTopic:
    """Return a topic for writing to another bag: if the topic has no readable definition, a copy with the text and hash
    of `definition`.
    """
    if has_definition(topic):
        return topic
    text, encoding = definition_of(definition.message_class)
    return replace(topic, definition=text, encoding=encoding, type_hash=definition.type_hash)


def definition_of(cls: type[Any]) -> tuple[str, str]:
    """Return the definition text of a message class with all types it uses, and the text's encoding."""
    text = definition_text(cls)
    return text, "ros2idl" if text.startswith("=") else "ros2msg"


def same_definition(one: BagTopic, other: BagTopic) -> bool:
    """Return True if messages of both channels are decoded in the same way: type hashes or definitions are equal.

    Returns False if that cannot be determined.
    """
    if one.type_hash and other.type_hash:
        return one.type_hash == other.type_hash
    if one.definition == other.definition:
        return True
    try:
        return (
            has_definition(one) and has_definition(other) and type_hash(_compiled(one)) == type_hash(_compiled(other))
        )
    except RosidlError:
        return False


def is_empty(data: bytes | memoryview) -> bool:
    """Return True if the CDR data can be a message without fields, which has one zero byte, perhaps with padding, after
    the header.
    """
    size = len(data) - Header.SIZE
    return len(EMPTY_MESSAGE) <= size <= Alignment.NETWORK and not any(data[Header.SIZE :])


def _compiled(topic: BagTopic) -> type[Any]:
    try:
        cls = compile_definition(topic.type_name, topic.definition)
    except InvalidNameError as error:
        raise BagError(f"{topic.name}: {error}") from None
    if isinstance(cls, type) and hasattr(cls, "decode"):
        return cls
    raise BagError(f"{topic.name}: {topic.type_name} is not a message type")


class WrongDefinitionError(BagError):
    """Error of a message that does not fit the definition that was guessed for its topic."""


def checked_decoder(
    topic: BagTopic, definition: TopicDefinition, decode: Callable[[bytes | memoryview], Any], may_skip: bool
) -> Callable[[bytes | memoryview], Any]:
    """Return a decoder that checks message lengths and raises `WrongDefinitionError` if the guessed definition does not
    fit.

    With `may_skip`, a message that is too short after a message of valid length counts as damaged, and raises
    `DecodeError`.
    """
    cls = definition.message_class
    is_fixed = not varying_field(cls)
    valid_sizes: set[int] = set()
    count, next_check = 0, 0

    def decode_checked(data: bytes | memoryview) -> Any:
        nonlocal count, next_check
        try:
            message = decode(data)
        except DecodeError as error:
            if may_skip and valid_sizes:
                raise
            text = f"a message of {len(data)} bytes: {error}"
            raise WrongDefinitionError(f"{topic.name}: {text}; {_guess_warning(definition)}") from None
        if count == next_check or (is_fixed and len(data) not in valid_sizes):
            next_check = max(next_check, count + (1 if count < _CHECK_FIRST_MESSAGES else _CHECK_EVERY))
            if rest := trailing_bytes(cls, data):
                raise WrongDefinitionError(f"{topic.name}: {rest}; {_guess_warning(definition)}")
            if is_fixed or not valid_sizes:
                valid_sizes.add(len(data))
        count += 1
        return message

    return decode_checked


def mismatch_reason(topic: BagTopic, definition: TopicDefinition, samples: Iterable[bytes]) -> str:
    """Return a text that states why sample messages of a topic do not fit a guessed definition; "" if all
    of them fit.
    """
    decode = checked_decoder(topic, definition, decoder_of(definition.message_class, False), False)
    try:
        for data in samples:
            decode(data)
    except WrongDefinitionError as error:
        return str(error)
    return ""


def trailing_bytes(cls: type[Message], data: bytes | memoryview) -> str:
    """Return a description of the bytes after a message's last field; "" if there are none or they are padding.

    Raises `DecodeError` if the data is not a message of the class.
    """
    size = len(data)
    if not cls._TYPE.fields:
        return "" if size == Header.SIZE or is_empty(data) else f"{size} bytes of a message without fields"
    rest = size - encoded_length(cls, data)
    if not rest or (rest < Alignment.NETWORK and not (size - Header.SIZE) % Alignment.NETWORK):
        return ""
    return f"{rest} of {size} bytes of a message are after its last field"


def _guess_warning(definition: TopicDefinition) -> str:
    return (
        f"{definition.origin}, used because the bag has no definition of {definition.message_class._TYPE.name}, "
        f"differs from the recorded definition, or the message is damaged; {_ADVICE}"
    )


# ------------------------------------------------------------------------------------------------------------ decoders


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
        """Return the decoder of a schema's messages; None if the schema is not one of ROS 2.

        Raises:
            DefinitionError: the schema's text is invalid.
        """
        if message_encoding != "cdr" or schema is None or schema.encoding not in ENCODINGS:
            return None
        key = schema.name, schema.data
        if key not in self._decoders:
            self._decoders[key] = decoder_of(_class_of_schema(schema.name, schema.data), self._arrays)
        return self._decoders[key]


def decoder_of(cls: type[Any], arrays: bool) -> Callable[[bytes | memoryview], Any]:
    """Return the function that decodes messages of a class: the class's own `decode` if possible, as a wrapper costs
    time.
    """
    if not cls._TYPE.fields:
        return partial(_decode_empty, cls)
    if any(field.py_name == "decode" for field in cls._TYPE.fields):  # the field has taken the method's place
        return partial(decode, cls, arrays=arrays)
    return partial(cls.decode, arrays=True) if arrays else cls.decode


def _decode_empty(cls: type[Any], data: bytes | memoryview) -> Any:
    """Decode a message without fields.

    ROS writes one byte for it and other writers write none, so a missing byte is added.
    """
    return cls.decode(bytes(data) + b"\0" if len(data) == Header.SIZE else data)


def _class_of_schema(name: str, definition: bytes) -> type[Any]:
    """Return the message class that an MCAP schema defines.

    Raises:
        DefinitionError: the schema cannot be read, or is not a message's.
    """
    try:
        cls = compile_definition(name, definition.decode())
    except (UnicodeDecodeError, InvalidNameError) as error:
        raise DefinitionError(Diagnostic(f"<{name[:100]}>", 0, 0, f"the schema cannot be read: {error}")) from None
    if not issubclass(cls, Message):
        text = "the schema defines a service or action; expected a message"
        raise DefinitionError(Diagnostic(f"<{name[:100]}>", 0, 0, text))
    return cls
