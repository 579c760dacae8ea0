"""Classes for the channels of a bag, also for those whose bag does not have their definitions, as SQLite before Iron.

Decides which definition is believed: that in the bag; else, where the bag has the hash of one, only one with this hash;
else the first of this name: what the caller gives, then what is importable, on the search path or bundled. That one is
a guess. It is said once which was taken, and messages are measured: one that is not read to its end, or that ends
before, was written with another definition.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

from rosidl_py_gen import compile_definition, get_message, type_hash
from rosidl_py_gen.bags.common import BagError, BagTopic, BagWarning
from rosidl_py_gen.bags.decoder import ENCODINGS, decoder_of
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.cdr.field_walk import encoded_length
from rosidl_py_gen.cdr.layout import EMPTY_MESSAGE, HEADER_BYTES, NETWORK_ALIGN
from rosidl_py_gen.cdr.structured_layout import varying_field
from rosidl_py_gen.errors import DecodeError, DefinitionError, InvalidNameError, RosidlError, printable
from rosidl_py_gen.type_loading.class_lookup import SearchFolders, definition_origin, find_class
from rosidl_py_gen.type_loading.from_description import definition_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from pathlib import Path

Typestore: TypeAlias = "Mapping[str, type[Message] | str]"
"""Classes, or texts of definitions with all they use, by full name."""

_CHECK_FIRST_MESSAGES = 10
_CHECK_EVERY = 256
"""So many messages of a channel are measured, then one of these: measuring takes up to 45 times as long as decoding.

Those of fixed size are all compared with the sizes that were right.
"""
_UNKNOWN, _SERVICE = "unknown", re.compile(r"=+\r?\nSRV: ")
"""What rosbag2 says of services that use no other types, and how the text of one begins."""
NO_FIELDS = "an empty definition in the bag"
_ADVICE = "give the folder with the definition of then (search_path=, --path)"


@dataclass(frozen=True, slots=True)
class TopicDefinition:
    """The definition that messages of a bag are decoded with.

    Attributes:
        message_class: the class of the messages.
        origin: where it is from: ``the bag``, ``an empty definition in the bag``, ``typestore``, a file, a module, or
            ``bundled``.
        is_recorded: it is that of the recording, as it is in the bag or has the recorded hash. False is a guess by
            name.
    """

    message_class: type[Any]
    origin: str
    is_recorded: bool

    @property
    def type_hash(self) -> str:
        """RIHS01 of the class."""
        return type_hash(self.message_class)


class Definitions:
    """Finds the class of each channel of a bag.

    Args:
        bag: for messages.
        hashes: of ``metadata.yaml``, by topic and type, for files that do not have them.

    Raises:
        TypeError: something else in `typestore`. InvalidNameError: a name in it is none.
    """

    def __init__(
        self, bag: Path, search_path: SearchFolders, typestore: Typestore | None, hashes: Mapping[tuple[str, str], str]
    ) -> None:
        self._bag = bag
        self._search_path = search_path
        self._given: dict[str, type[Message] | str] = {}
        for name, given in (typestore or {}).items():
            if not isinstance(given, str) and not (isinstance(given, type) and issubclass(given, Message)):
                raise TypeError(f"typestore: {name}: expected a message class or the text of a definition")
            self._given[str(split_ros_name(name, "msg"))] = given
        self._hashes = hashes
        self._known: dict[tuple[str, ...], TopicDefinition] = {}
        self._has_warned = False

    def find(self, topic: BagTopic) -> TopicDefinition:
        """Raises `BagError`: none is known, none has the recorded hash, messages are no CDR; `DefinitionError`."""
        found = self._known.get(topic.key)
        if found is None:
            found = self._known[topic.key] = self._found(topic)
        return found

    def class_of(self, topic: BagTopic) -> type[Any]:
        """The class, with a warning the first time it is a guess; errors as `find`."""
        found = self.find(topic)
        if not found.is_recorded and found.message_class._TYPE.fields and not self._has_warned:
            self._has_warned = True
            text = (
                f"{self._bag}: no definition and no hash of {topic.type_name} ({topic.name}) is in it: {found.origin} "
                "is taken, which may not be that of the recording, and so for all its topics without; "
                "BagReader.definition and `rosidl-py bag info --verbose` tell which, search_path= and --path give "
                "others"
            )
            warnings.warn(printable(text), BagWarning, stacklevel=4)
        return found.message_class

    def _found(self, topic: BagTopic) -> TopicDefinition:
        if topic.message_encoding != "cdr":
            raise BagError(f"{topic.name}: messages are {topic.message_encoding}, not cdr")
        if has_definition(topic):
            return TopicDefinition(_compiled(topic), "the bag", True)
        wanted = topic.type_hash or self._hashes.get((topic.name, topic.type_name), "")
        try:
            name = str(split_ros_name(topic.type_name, "msg"))
            return self._with_hash(topic, name, wanted) if wanted else self._guessed(name)
        except RosidlError as error:
            if topic.encoding in ENCODINGS:  # an empty definition is what it says, then: that of an empty message
                cls = _compiled(topic)
                if wanted in ("", type_hash(cls)):
                    return TopicDefinition(cls, NO_FIELDS, bool(wanted))
            if isinstance(error, BagError):
                raise
            said = (
                error.diagnostics[0] if isinstance(error, DefinitionError) else error
            )  # a line, without the text there
            raise BagError(f"{topic.name}: the bag has no definition of {topic.type_name}, and {said}") from None

    def _guessed(self, name: str) -> TopicDefinition:
        """The first of this name."""
        cls = self._of_store(name)
        if cls is not None:
            return TopicDefinition(cls, "typestore", False)
        cls = get_message(name, path=self._search_path)
        return TopicDefinition(cls, definition_origin(cls, path=self._search_path), False)

    def _with_hash(self, topic: BagTopic, name: str, wanted: str) -> TopicDefinition:
        """The one with the recorded hash; raises `BagError` when others of this name are all there is."""
        cls = self._of_store(name)
        if cls is not None and type_hash(cls) == wanted:
            return TopicDefinition(cls, "typestore", True)
        cls = find_class(name, lambda hashes: hashes[name] == wanted, path=self._search_path)
        if cls is not None and issubclass(cls, Message):
            return TopicDefinition(cls, definition_origin(cls, path=self._search_path), True)
        other = self._guessed(name)
        raise BagError(
            f"{topic.name}: the bag has no definition of {name}, but its hash {wanted}, and {other.origin} has "
            f"{other.type_hash}: {_ADVICE}, or typestore="
        )

    def _of_store(self, name: str) -> type[Message] | None:
        given = self._given.get(name)
        return _compiled(BagTopic("typestore", name, given)) if isinstance(given, str) else given


def has_definition(topic: BagTopic) -> bool:
    """Whether the bag has one that can be read."""
    is_service = topic.encoding == _UNKNOWN and _SERVICE.match(topic.definition) is not None
    return bool(topic.definition) and (topic.encoding in ENCODINGS or is_service)


def described(topic: BagTopic, found: TopicDefinition) -> BagTopic:
    """The channel with the definition that is taken for it, for writing it again."""
    if has_definition(topic):
        return topic
    text = definition_text(found.message_class)
    encoding = "ros2idl" if text.startswith("=") else "ros2msg"
    return replace(topic, definition=text, encoding=encoding, type_hash=found.type_hash)


def same_definition(one: BagTopic, other: BagTopic) -> bool:
    """Whether messages of both are read alike, as far as is known."""
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
    """Whether this is a message without fields: in CDR it has a byte, and perhaps padding."""
    size = len(data) - HEADER_BYTES
    return len(EMPTY_MESSAGE) <= size <= NETWORK_ALIGN and not any(data[HEADER_BYTES:])


def _compiled(topic: BagTopic) -> type[Any]:
    try:
        cls = compile_definition(topic.type_name, topic.definition)
    except InvalidNameError as error:
        raise BagError(f"{topic.name}: {error}") from None
    if isinstance(cls, type) and hasattr(cls, "decode"):
        return cls
    raise BagError(f"{topic.name}: {topic.type_name} is no message")


# ----------------------------------------------------------------------------------------------------------- measuring


class WrongDefinitionError(BagError):
    """A message was not written with the definition that was taken for lack of one in the bag."""


def checked_decoder(
    topic: BagTopic, found: TopicDefinition, decode: Callable[[bytes | memoryview], Any], may_skip: bool
) -> Callable[[bytes | memoryview], Any]:
    """`decode` of a guess: raises `WrongDefinitionError`.

    With `may_skip`, a message that ends too early behind others that do not is a damaged one: `DecodeError`.
    """
    cls = found.message_class
    is_fixed = not varying_field(cls)
    right: set[int] = set()
    count, due = 0, 0

    def measured_too(data: bytes | memoryview) -> Any:
        nonlocal count, due
        try:
            message = decode(data)
        except DecodeError as error:
            if may_skip and right:
                raise
            text = f"a message of {len(data)} bytes: {error}"
            raise WrongDefinitionError(f"{topic.name}: {text}; {_guess_warning(found)}") from None
        if count == due or (is_fixed and len(data) not in right):
            due = max(due, count + (1 if count < _CHECK_FIRST_MESSAGES else _CHECK_EVERY))
            if rest := trailing_bytes(cls, data):
                raise WrongDefinitionError(f"{topic.name}: {rest}; {_guess_warning(found)}")
            if is_fixed or not right:
                right.add(len(data))
        count += 1
        return message

    return measured_too


def mismatch_reason(topic: BagTopic, found: TopicDefinition, samples: Iterable[bytes]) -> str:
    """Why a guess is not what these were written with; empty when they fit, and where it is no guess."""
    for data in () if found.is_recorded else samples:
        try:
            decoder_of(found.message_class, False)(data)
            reason = trailing_bytes(found.message_class, data)
        except DecodeError as error:
            reason = f"a message of {len(data)} bytes: {error}"
        if reason:
            return f"{topic.name}: {reason}; {_guess_warning(found)}"
    return ""


def trailing_bytes(cls: type[Message], data: bytes | memoryview) -> str:
    """What is behind the last field of a message; empty when it is nothing but padding; raises `DecodeError`."""
    whole = len(data)
    if not cls._TYPE.fields:
        return "" if whole == HEADER_BYTES or is_empty(data) else f"{whole} bytes of a message without fields"
    rest = whole - encoded_length(cls, data)
    if not rest or (rest < NETWORK_ALIGN and not (whole - HEADER_BYTES) % NETWORK_ALIGN):
        return ""
    return f"{rest} of {whole} bytes of a message are behind its last field"


def _guess_warning(found: TopicDefinition) -> str:
    return (
        f"{found.origin}, taken because the bag has no definition of {found.message_class._TYPE.name}, is not that of "
        f"the recording, or the message is damaged: {_ADVICE}"
    )
