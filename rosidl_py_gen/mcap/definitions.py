"""Classes for topics whose bag does not have their definitions: SQLite files before Iron, and what some tools write.

Decides which definition is believed: one that the caller names, else one with the hash that was recorded, else, where
no hash was recorded, one of the same name. That may be another version than that of the recording, so it is said which
one was taken, and messages are measured: one that is longer or shorter than this definition makes it was written with
another.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

from rosidl_py_gen import compile_text, get_message, type_hash
from rosidl_py_gen.dynamic import Folders, definition_source, find_class
from rosidl_py_gen.errors import DecodeError, InvalidNameError, RosidlError
from rosidl_py_gen.mcap.common import BagError, BagTopic
from rosidl_py_gen.mcap.decoder import ENCODINGS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rosidl_py_gen.cdr import Message

Typestore: TypeAlias = "Mapping[str, type[Message] | str]"
"""Classes, or texts of definitions with all they use, by full name."""

_CLOSELY = 100
"""So many messages of a topic are measured, then one of so many."""
_EMPTY_BYTES = 5, 8
_PADDING = 3
"""Bytes that may follow a message: samples of DDS are multiples of four."""


class Definitions:
    """Finds the class of each channel of a bag.

    Attributes:
        taken: where definitions that the bag does not have were taken from, by topic, for people.
    """

    def __init__(self, path: Folders, typestore: Typestore, hashes: Mapping[str, str]) -> None:
        self._path = path
        self._typestore = typestore
        self._hashes = hashes
        self._classes: dict[tuple[str, ...], type[Any]] = {}
        self.taken: dict[str, str] = {}

    def class_of(self, topic: BagTopic) -> type[Any]:
        """Raises `BagError`, `DefinitionError`."""
        cls = self._classes.get(topic.key)
        if cls is None:
            cls = self._classes[topic.key] = self._found(topic)
        return cls

    def _found(self, topic: BagTopic) -> type[Any]:
        if topic.message_encoding != "cdr":
            raise BagError(f"{topic.name}: messages are {topic.message_encoding}, not cdr")
        if topic.encoding in ENCODINGS and topic.definition:
            return _compiled(topic)
        if (own := self._typestore.get(topic.type_name)) is not None:
            self.taken[topic.name] = "typestore"
            return _compiled(replace(topic, definition=own)) if isinstance(own, str) else own
        if not topic.type_hash:
            topic = replace(topic, type_hash=self._hashes.get(topic.name, ""))
        try:
            cls = self._by_hash(topic) if topic.type_hash else get_message(topic.type_name, path=self._path)
            self.taken[topic.name] = definition_source(topic.type_name, path=self._path)
            return cls
        except RosidlError as error:
            if topic.encoding in ENCODINGS:  # an empty definition is what it says, then: that of an empty message
                return _compiled(topic)
            raise BagError(f"{topic.name}: the bag has no definition of {topic.type_name}, and {error}") from None

    def _by_hash(self, topic: BagTopic) -> type[Any]:
        name, wanted = topic.type_name, topic.type_hash
        cls = find_class(name, lambda hashes: hashes[name] == wanted, path=self._path)
        if cls is not None:
            return cls
        other = get_message(name, path=self._path)
        raise BagError(
            f"what is known of that name here ({definition_source(name, path=self._path)}) has the hash "
            f"{type_hash(other)}, and it was recorded with {wanted}: name the folder of its package in path="
        )

    def needs_measuring(self, topic: BagTopic) -> bool:
        """Whether messages may have been written with another definition than the one that was taken."""
        return not (topic.definition or topic.type_hash or self._hashes.get(topic.name))

    def measuring(
        self, topic: BagTopic, cls: type[Any], decode: Callable[[bytes | memoryview], Any]
    ) -> Callable[[bytes | memoryview], Any]:
        """`decode`, which raises `WrongDefinitionError` too."""
        source = self.taken.get(topic.name, "an empty definition in the bag")
        counted = 0

        def measured(data: bytes | memoryview) -> Any:
            nonlocal counted
            counted += 1
            try:
                message = decode(data)
                if counted > _CLOSELY and counted % _CLOSELY:
                    return message
                size = len(cls.decode(data).encode())
            except DecodeError as error:
                raise WrongDefinitionError(_wrong(topic, source, f"a message of {len(data)} bytes: {error}")) from None
            if not 0 <= len(data) - size <= _PADDING:
                raise WrongDefinitionError(
                    _wrong(topic, source, f"it makes {size} bytes of a message that has {len(data)}")
                )
            return message

        return measured


class WrongDefinitionError(BagError):
    """A message was not written with the definition that was taken for lack of one in the bag."""


def _wrong(topic: BagTopic, source: str, found: str) -> str:
    return (
        f"{topic.name}: the bag has no definition of {topic.type_name}, and that of {source} is not the one it was "
        f"recorded with: {found}; name the folder of its package in path="
    )


def is_empty(data: bytes | memoryview) -> bool:
    """Whether this is a message without fields: in CDR it has a byte, and perhaps padding."""
    return _EMPTY_BYTES[0] <= len(data) <= _EMPTY_BYTES[1] and not any(data[4:])


def _compiled(topic: BagTopic) -> type[Any]:
    try:
        cls = compile_text(topic.type_name, topic.definition)
    except InvalidNameError as error:
        raise BagError(f"{topic.name}: {error}") from None
    if isinstance(cls, type) and hasattr(cls, "decode"):
        return cls
    raise BagError(f"{topic.name}: {topic.type_name} is no message")
