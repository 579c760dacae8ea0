"""Reader of bags: MCAP files, rosbag2 folders of MCAP or SQLite files, single ``.db3`` files.

Each message is decoded with the definition it was written with, even if its topic has several. Messages that cannot be
decoded are skipped, counted and reported when all topics are read, and raise an error when their topic is requested.
"""

from __future__ import annotations

import asyncio
import warnings
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, TypeVar, overload

from rosidl_py_gen import type_hash
from rosidl_py_gen.bags.common import (
    BagError,
    BagMessage,
    BagTopic,
    BagWarning,
    DamagedPart,
    RawMessage,
    SkippedMessages,
)
from rosidl_py_gen.bags.definition_lookup import (
    NO_FIELDS,
    Definitions,
    TopicDefinition,
    WrongDefinitionError,
    checked_decoder,
    decoder_of,
    is_empty,
)
from rosidl_py_gen.bags.numpy_table import table, to_dataframe
from rosidl_py_gen.bags.remote import bag_path
from rosidl_py_gen.bags.storage.bag_files import open_files
from rosidl_py_gen.bags.storage.storage_api import (
    BagChannel,
    RawTuple,
    ReadingProgress,
    TableInput,
    as_bag_messages,
    as_raw_messages,
    as_table_input,
    merge_by_time,
    merge_channels,
    merge_stored_channels,
    split_times,
    topics_by_name,
)
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.errors import DecodeError, RosidlError

if TYPE_CHECKING:
    import os
    from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Sequence

    import numpy as np
    from typing_extensions import Self

    from rosidl_py_gen.bags.definition_lookup import Typestore
    from rosidl_py_gen.type_loading import SearchFolders

MessageT = TypeVar("MessageT", bound=Message)
_END = 1 << 64
_MAX_DAMAGE_WARNINGS = 20


class BagReader:
    """Recorded bag that is read. Use it with ``with``.

    Iterating yields a `BagMessage` for each message by log time; `messages` selects topics and times. Several threads
    may iterate at the same time, each with an iterator of its own.

    Args:
        path: an ``.mcap`` or ``.db3`` file, or a rosbag2 folder; also with rosbag2's zstd compression, of files
            (``.mcap.zstd``, ``.db3.zstd``; decompressed into a temporary folder) or of messages. Or a URL such as
            ``s3://bucket/drive.mcap``, with the extra ``tables``: MCAP files are then read by ranges.
        validate_crcs: compare the checksum of each chunk of an MCAP file. For images and clouds this takes most of the
            time. With False, damage is found only where it breaks the format.
        max_decompressed_bytes: maximum size of a decompressed chunk or message. A few bytes can state any size; 1 GiB
            is enough unless there are larger messages.
        search_path: folders with the packages of the recording, for bags without definitions (SQLite bags before Iron).
            Definitions are searched in this order:

            - `search_path`;
            - the bundled definitions of the recording's distribution, if the bag states a distribution;
            - AMENT_PREFIX_PATH;
            - the bundled interfaces, as by `get_message`.
        skip_damaged: skip damaged parts of MCAP files and record them in `damaged`; by default they raise `BagError`
            with the place, the log times and the topics.
        typestore: definitions by name, which precede `search_path`: ``{"my_msgs/msg/Thing": Thing}``, or texts.
        on_progress: called with the number of bytes that are read, and the number of all bytes, while files are
            decompressed, or read completely because they have no index.

    Raises:
        BagError: the bag is damaged beyond reading, or of an unknown kind.
        OSError: the bag cannot be opened.

    A `BagWarning` reports unfinished records at the end of files, and messages that ``metadata.yaml`` lists and the
    files lack.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        validate_crcs: bool = True,
        max_decompressed_bytes: int = 1_073_741_824,
        search_path: SearchFolders = (),
        typestore: Typestore | None = None,
        skip_damaged: bool = False,
        on_progress: Callable[[int, int], object] | None = None,
    ) -> None:
        self.path = bag_path(path)
        self.damaged: list[DamagedPart] = []
        """Damaged parts of MCAP files that were skipped so far; a `BagWarning` reports each of the first 20."""
        self._known_damage: set[DamagedPart] = set()
        self._resources = ExitStack()
        self.skipped: dict[str, SkippedMessages] = {}
        """Topics whose messages `messages` could not decode and skipped so far, with their number and the reason."""
        try:
            self.files, self._files, self._metadata = open_files(
                self.path,
                self._resources,
                validate_crcs,
                max_decompressed_bytes,
                self._add_damaged if skip_damaged else None,
                ReadingProgress(on_progress),
            )
            """Paths of the files of the bag."""
            listed = self._metadata.topics if self._metadata is not None else ()
            hashes = {(topic.name, topic.type_name): topic.type_hash for topic in listed if topic.type_hash}
            self._definitions = Definitions(self.path, search_path, typestore, hashes, self._ros_distro)
            self._stored_channels, channels, topics, start_ns, end_ns = self._contents()
            self.channels: list[BagTopic] = channels
            """Recorded topics, with an entry for each definition of a topic."""
            self.topics: dict[str, BagTopic] = topics
            """Recorded topics by name; the first definition of a topic that has several."""
            self.start_ns: int = start_ns
            """Log time of the first message, nanoseconds since 1970; 0 without messages."""
            self.end_ns: int = end_ns
            """Log time of the last message, nanoseconds since 1970; 0 without messages."""
            self.has_index: bool = all(file.is_whole for file in self._files)
            """True if all files have an index; files without one, as after a crash, are read completely."""
            self.unread_bytes: int = sum(file.unread_bytes for file in self._files)
            """Size of unfinished records at the end of files, as after a crash; each is reported by a `BagWarning`."""
            for file, lost in zip(self.files, (storage.unread_bytes for storage in self._files), strict=True):
                if lost:
                    text = f"{file} breaks off within a record; its last {lost} bytes are lost"
                    warnings.warn(text, BagWarning, stacklevel=2)
            counts = {name: topic.count for name, topic in topics.items()}
            if self._metadata is not None and (note := self._metadata.loss_note(counts)):
                warnings.warn(f"{self.path}: {note}", BagWarning, stacklevel=2)
        except BaseException:
            self.close()
            raise

    def _contents(self) -> tuple[list[BagTopic], list[BagTopic], dict[str, BagTopic], int, int]:
        """Return what the files of the bag state: stored channels, merged channels, topics, first and last log time."""
        stored = merge_stored_channels(channel for file in self._files for channel in file.stored_channels())
        channels = merge_channels(stored)  # of one topic and definition there are several if QoS or metadata differ
        spans = [span for file in self._files if (span := file.span()) is not None]
        start, end = min((first for first, _ in spans), default=0), max((last for _, last in spans), default=0)
        return stored, channels, topics_by_name(channels), start, end

    def _add_damaged(self, part: DamagedPart) -> None:
        if part in self._known_damage:
            return
        self._known_damage.add(part)
        self.damaged.append(part)
        if len(self.damaged) <= _MAX_DAMAGE_WARNINGS:
            more = "; further ones are not reported" if len(self.damaged) == _MAX_DAMAGE_WARNINGS else ""
            text = f"{part.file}: skipped a damaged part, {part.place}: {part.reason}{more}"
            warnings.warn(text, BagWarning, stacklevel=2)

    def message_class(self, topic: str | BagTopic) -> type[Any]:
        """Return the class of a topic's messages: of the definition in the bag, else of one with its name and hash.

        If the bag has neither definition nor hash, the first definition of that name is used, with one `BagWarning` for
        the bag.

        Args:
            topic: a name, or one of `channels`.

        Raises:
            BagError: the topic does not exist, has no known definition, none with the recorded hash, or several; pass
                one of `channels` in the last case.
            DefinitionError: the bag's definition is invalid.
        """
        self.definition(topic)
        channels = [topic] if isinstance(topic, BagTopic) else self._channels_of(topic)
        return self._definitions.class_of(channels[0])

    def _ros_distro(self) -> str:
        """Return the recorder's distribution, which ``metadata.yaml`` or a file of the bag states; "" if none does."""
        stated = "" if self._metadata is None else self._metadata.ros_distro
        return stated or next((name for name in (file.ros_distro() for file in self._files) if name), "")

    def definition(self, topic: str | BagTopic) -> TopicDefinition:
        """Return the definition of a topic's messages; its `is_recorded` is False if it was guessed by the type's name.

        Args:
            topic: a name, or one of `channels`.

        Raises:
            BagError: the topic does not exist, has no known definition, none with the recorded hash, or several; pass
                one of `channels` in the last case.
            DefinitionError: the bag's definition is invalid.
        """
        if isinstance(topic, BagTopic):
            return self._definitions.find(topic)
        definitions = {entry.message_class: entry for entry in map(self._definitions.find, self._channels_of(topic))}
        if len(definitions) > 1:
            raise BagError(
                f"{self.path}: {topic} was recorded with {len(definitions)} definitions; pass one of `channels`, "
                "or read `messages`"
            )
        return next(iter(definitions.values()))

    def _channels_of(self, name: str) -> list[BagTopic]:
        if name not in self.topics:
            raise BagError(f"{self.path} has no topic {name}{did_you_mean(name, self.topics)}")
        return [one for one in self.channels if one.name == name]

    @overload
    def messages(
        self, topics: Iterable[str] | str, message_class: type[MessageT], *, start_ns: int | None = ...,
        end_ns: int | None = ..., raw: Literal[False] = ..., arrays: bool = ...,
        on_error: Literal["raise", "skip"] = ...,
    ) -> Iterator[BagMessage[MessageT]]: ...  # fmt: skip
    @overload
    def messages(
        self, topics: Iterable[str] | str | None = ..., message_class: None = ..., *, raw: Literal[True],
        start_ns: int | None = ..., end_ns: int | None = ..., arrays: bool = ...,
        on_error: Literal["raise", "skip"] = ...,
    ) -> Iterator[BagMessage[bytes]]: ...  # fmt: skip
    @overload
    def messages(
        self, topics: Iterable[str] | str | None = ..., message_class: None = ..., *, start_ns: int | None = ...,
        end_ns: int | None = ..., raw: bool = ..., arrays: bool = ..., on_error: Literal["raise", "skip"] = ...,
    ) -> Iterator[BagMessage]: ...  # fmt: skip
    def messages(
        self,
        topics: Iterable[str] | str | None = None,
        message_class: type[Message] | None = None,
        *,
        start_ns: int | None = None,
        end_ns: int | None = None,
        raw: bool = False,
        arrays: bool = False,
        on_error: Literal["raise", "skip"] = "raise",
    ) -> Iterator[BagMessage[Any]]:
        """Yield messages by log time, each decoded with the definition it was written with.

        Args:
            topics: names of topics. None means all topics with a known type, and all if `raw`; skipped messages are
                counted in `skipped`, and a `BagWarning` reports each such topic.
            message_class: class of the messages of `topics`, which type checkers then know. It must have the recorded
                definition.
            start_ns: first log time.
            end_ns: end of the log times, exclusive.
            raw: messages stay CDR bytes, without decoding.
            arrays: sequences of fixed-size messages become structured arrays, as in `decode`.
            on_error: ``"skip"`` skips damaged messages; ``"raise"`` raises an error.

        Raises:
            TypeError: `message_class` is not a message class, or is passed without topics or with `raw`.
            ValueError: `on_error` has another value.
            BagError: the bag is damaged, a topic does not exist, one of `topics` cannot be decoded, or it has another
                type or definition than `message_class`.
            DecodeError: a message is damaged; names the topic and the time.
        """
        may_skip = _may_skip(on_error)
        names = self._names(topics)
        if message_class is not None:
            if names is None or raw:
                raise TypeError("message_class: passed without topics or with raw=True; expected decoded topics")
            for name in names:
                self._require_class(name, message_class)
        messages = self._merged(names, start_ns, end_ns)
        if raw:
            return as_bag_messages(messages)
        for name in names or ():
            for channel in self._channels_of(name):
                self.message_class(channel)
        return self._decoded(messages, arrays, names is None, may_skip, message_class)

    def _require_class(self, topic: str, message_class: type[Message]) -> None:
        """Raise an error if a topic has messages of another type or definition than `message_class`.

        Raises:
            TypeError: `message_class` is not a message class.
            BagError: a type or definition differs.
        """
        if not (isinstance(message_class, type) and issubclass(message_class, Message)):
            raise TypeError(f"message_class: got {message_class!r}; expected a message class")
        expected = message_class._TYPE.name
        for channel in self._channels_of(topic):
            recorded = self.message_class(channel)
            name = recorded._TYPE.name
            if name != expected:
                raise BagError(f"{self.path}: {topic} has messages of {name}; expected {expected}, as passed")
            if recorded is not message_class and type_hash(recorded) != type_hash(message_class):
                raise BagError(
                    f"{self.path}: {topic} was recorded with another definition of {name} than the class passed; omit "
                    "the class to read the recorded fields, or convert the bag with `rosidl-py bag migrate`"
                )

    def raw_messages(
        self,
        topics: Iterable[str] | str | None = None,
        *,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[RawMessage]:
        """Yield serialized messages of the selected topics and times by log time, with their channels.

        Args:
            topics: names of topics; None means all.
            start_ns: first log time.
            end_ns: end of the log times, exclusive.

        Raises:
            BagError: the bag is damaged, or a topic does not exist.
        """
        return as_raw_messages(self._merged(self._names(topics), start_ns, end_ns))

    def _names(self, topics: Iterable[str] | str | None) -> list[str] | None:
        names = [topics] if isinstance(topics, str) else None if topics is None else list(topics)
        for name in names or ():
            self._channels_of(name)
        return names

    def _merged(self, names: list[str] | None, start_ns: int | None, end_ns: int | None) -> Iterator[RawTuple]:
        return merge_by_time(self._files, names, start_ns or 0, _END if end_ns is None else end_ns)

    def _decoded(
        self,
        messages: Iterable[RawTuple],
        arrays: bool,
        may_skip_topic: bool,
        may_skip: bool,
        message_class: type[Message] | None = None,
    ) -> Iterator[BagMessage]:
        decoders: dict[BagChannel, Callable[[bytes | memoryview], Any] | None] = {}
        make = tuple.__new__  # twice as fast as BagMessage()
        for channel, data, log_time, publish_time, _ in messages:
            try:
                decode = decoders[channel]
            except KeyError:
                decode = decoders[channel] = self._decoder(
                    channel, data, arrays, may_skip_topic, may_skip, message_class
                )
            if decode is None:
                self._count_skipped(channel.topic)
                continue
            try:
                message = decode(data)
            except DecodeError as error:
                place = f"{self.path}: {channel.topic} at {log_time} ns: {error.path}"
                located = DecodeError(place, error.offset_bytes, error.reason)
                if not may_skip:
                    raise located from None
                self._count_skipped(channel.topic, located)
                continue
            except WrongDefinitionError as error:
                if not may_skip_topic:
                    raise WrongDefinitionError(f"{self.path}: {error}") from None
                decoders[channel] = None
                self._count_skipped(channel.topic, error)
                continue
            yield make(BagMessage, (channel.topic, message, log_time, publish_time))

    def _decoder(
        self,
        channel: BagChannel,
        first: bytes | memoryview,
        arrays: bool,
        may_skip_topic: bool,
        may_skip: bool,
        message_class: type[Message] | None,
    ) -> Callable[[bytes | memoryview], Any] | None:
        """Return the function that decodes a channel's messages.

        Returns None if the topic cannot be decoded and may be skipped. `first` is the first message of the channel.
        """
        topic = channel.info
        try:
            cls, definition = self._definitions.class_of(topic), self._definitions.find(topic)
            if definition.origin == NO_FIELDS and not (definition.is_recorded or is_empty(first)):
                raise BagError(f"{channel.topic}: no definition of {topic.type_name} is known")
        except RosidlError as error:
            if not may_skip_topic:
                raise
            self._count_skipped(channel.topic, error, 0)
            return None
        decode = decoder_of(message_class or cls, arrays)
        return decode if definition.is_recorded else checked_decoder(topic, definition, decode, may_skip)

    def _count_skipped(self, topic: str, error: RosidlError | None = None, count: int = 1) -> None:
        before = self.skipped.get(topic)
        if before is None:
            reason = str(error).removeprefix(f"{topic}: ")
            self.skipped[topic] = SkippedMessages(count, reason)
            warnings.warn(f"{self.path}: skipped {topic}: {reason}", BagWarning, stacklevel=4)
        else:
            self.skipped[topic] = replace(before, count=before.count + count)

    def __iter__(self) -> Iterator[BagMessage]:
        return self.messages()

    def play(
        self,
        topics: Iterable[str] | str | None = None,
        *,
        rate: float = 1.0,
        start_ns: int | None = None,
        end_ns: int | None = None,
        raw: bool = False,
    ) -> AsyncIterator[BagMessage]:
        """Yield messages at the recorded pace; other arguments and errors as for `messages`.

        Args:
            rate: factor of the speed; 2.0 plays twice as fast.

        Raises:
            ValueError: `rate` is not above 0.
        """
        if not rate > 0:
            raise ValueError(f"rate: got {rate}; expected a number above 0")
        return _at_recorded_pace(self.messages(topics, start_ns=start_ns, end_ns=end_ns, raw=raw), rate)

    def to_arrays(
        self,
        topic: str,
        fields: Sequence[str] | str | None = None,
        *,
        start_ns: int | None = None,
        end_ns: int | None = None,
        pad: float | str | None = None,
    ) -> np.ndarray[Any, np.dtype[np.void]]:
        """Return the messages of a topic as a structured array with a row for each message.

        Args:
            fields: paths such as ``"header.stamp"``, ``"position[1]"``, ``"ranges[0:10]"``, ``"ranges[:]"``,
                ``"transforms[0].transform"`` or ``"poses[:].position.x"``. None means all numbers and texts outside of
                arrays; the path of a message means all numbers and texts in it. Indices are indices of Python. Times
                become nanoseconds in int64.
            start_ns: first log time.
            end_ns: end of the log times, exclusive.
            pad: replaces elements that a message does not have, such as ``float("nan")`` or 0.

        Returns:
            Columns ``log_time`` (nanoseconds) and the fields, named by their paths. Fixed arrays and slices of known
            length have an additional axis. Other sequences are arrays in a column of objects; with `pad`, an axis as
            long as the longest. Texts are as long as the longest, or objects if one is far longer than the others.

        Raises:
            BagError: a topic or field does not exist, or differs in another definition of the topic; a sequence is too
                short and there is no `pad`, or `pad` is not of the field's type.
            DecodeError: a message is damaged; names the topic and the time.
        """
        classes = dict.fromkeys(self.message_class(one) for one in self._channels_of(topic))
        messages = self.messages(topic, start_ns=start_ns, end_ns=end_ns)
        return table(list(classes), messages, fields, f"{self.path}: {topic}", pad)

    def to_pandas(
        self,
        topic: str,
        fields: Sequence[str] | str | None = None,
        *,
        start_ns: int | None = None,
        end_ns: int | None = None,
        pad: float | str | None = None,
    ) -> Any:
        """Return the messages of a topic as a `pandas.DataFrame`, with the log times as index, in UTC.

        An array of known length becomes a column for each element, such as ``orientation_covariance[0]``. The arguments
        are the settings of `to_arrays`.

        Raises:
            ModuleNotFoundError: pandas is not installed.
            BagError: a topic or field does not exist, or differs in another definition of the topic; a sequence is too
                short and there is no `pad`, or `pad` is not of the field's type.
            DecodeError: a message is damaged; names the topic and the time.
        """
        return to_dataframe(self.to_arrays(topic, fields, start_ns=start_ns, end_ns=end_ns, pad=pad))

    def batches(
        self,
        topic: str | BagTopic,
        columns: Sequence[str] | str | None = None,
        *,
        start_ns: int | None = None,
        end_ns: int | None = None,
        on_error: Literal["raise", "skip"] = "raise",
        batch_bytes: int = 2_097_152,
    ) -> Any:
        """Return the messages of a topic as a ``pyarrow.RecordBatchReader``, which polars, pandas and DuckDB accept.

        The columns are ``log_time``, ``publish_time`` and the fields, with structs for nested messages. Needs the extra
        ``tables``.

        Args:
            topic: a name, or one of `channels`, for messages of this definition only.
            columns: paths such as ``"header.stamp"``, which name their columns; None means all fields. Other fields are
                not decoded.
            start_ns: first log time.
            end_ns: end of the log times, exclusive.
            on_error: ``"skip"`` skips damaged messages; ``"raise"`` raises an error.
            batch_bytes: size of the messages of a batch, which has at least one message.

        Raises:
            ExtraMissingError: pyarrow is not installed.
            ValueError: `on_error` has another value.
            BagError: a topic or column does not exist, definitions of the topic have different columns, or a time or a
                column cannot be represented in Arrow; or, while reading, the bag is damaged.
            DecodeError: a message is damaged; names the topic and the time.
        """
        from rosidl_py_gen.tables import reader

        channels = [topic] if isinstance(topic, BagTopic) else self._channels_of(topic)
        source = self._source([channels[0].name], start_ns, end_ns, on_error)
        return reader(self, channels, columns, source.messages_or_blocks, source.decoded, batch_bytes)

    def _source(
        self, names: list[str], start_ns: int | None, end_ns: int | None, on_error: str, may_skip_topic: bool = False
    ) -> TableInput:
        may_skip = _may_skip(on_error)
        messages = as_table_input(self._files, names, start_ns or 0, _END if end_ns is None else end_ns)
        return TableInput(messages, lambda some: self._decoded(some, False, may_skip_topic, may_skip))

    def _cuts(self, size: int) -> list[int]:
        return split_times(self._files, size)

    def table(
        self,
        topic: str | BagTopic,
        columns: Sequence[str] | str | None = None,
        *,
        start_ns: int | None = None,
        end_ns: int | None = None,
        on_error: Literal["raise", "skip"] = "raise",
    ) -> Any:
        """Return the messages of a topic as a ``pyarrow.Table`` in memory; arguments and errors as for `batches`."""
        return self.batches(topic, columns, start_ns=start_ns, end_ns=end_ns, on_error=on_error).read_all()

    def close(self) -> None:
        """Close the files of the bag; may be called repeatedly."""
        self._resources.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        count = sum(topic.count or 0 for topic in self.topics.values())
        messages = (
            pluralize(count, "message")
            if all(topic.count is not None for topic in self.topics.values())
            else "messages"
        )
        return f"<BagReader {str(self.path)!r}: {messages} of {pluralize(len(self.topics), 'topic')}>"


def _may_skip(on_error: str) -> bool:
    if on_error not in ("raise", "skip"):
        raise ValueError(f'on_error: got {on_error!r}; expected "raise" or "skip"')
    return on_error == "skip"


async def _at_recorded_pace(messages: Iterable[BagMessage], rate: float) -> AsyncIterator[BagMessage]:
    clock = asyncio.get_running_loop().time
    start: tuple[float, int] | None = None
    for message in messages:
        start = start or (clock(), message.log_time)
        await asyncio.sleep(max(0.0, start[0] + (message.log_time - start[1]) / NS_PER_S / rate - clock()))
        yield message
