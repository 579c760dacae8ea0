"""Reading bags: MCAP files, rosbag2 folders of MCAP or SQLite files, single ``.db3`` files.

Decides which class a message is decoded with: that of the definition it was written with, also where a topic has two;
and what becomes of topics that cannot be decoded: they are left out of a reading of all topics, counted and named.
"""

from __future__ import annotations

import warnings
from contextlib import ExitStack
from dataclasses import replace
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Literal

from rosidl_py_gen.bags.common import BagError, BagMessage, BagTopic, BagWarning, RawMessage, SkippedMessages
from rosidl_py_gen.bags.decoder import decoder_of
from rosidl_py_gen.bags.definition_lookup import (
    NO_FIELDS,
    Definitions,
    TopicDefinition,
    WrongDefinitionError,
    checked_decoder,
    is_empty,
)
from rosidl_py_gen.bags.numpy_table import frame, table
from rosidl_py_gen.bags.pacing import at_recorded_pace
from rosidl_py_gen.bags.remote import bag_path
from rosidl_py_gen.bags.storage.damage import Skipped
from rosidl_py_gen.bags.storage.mcap_file import by_name, joined
from rosidl_py_gen.bags.storage.open_storage import open_files, split_times
from rosidl_py_gen.bags.storage.storage_api import (
    MAX_UNPACKED_BYTES,
    BagChannel,
    Raw,
    TableInput,
    as_table_input,
    merge_by_time,
    with_bytes,
)
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.errors import DecodeError, RosidlError

if TYPE_CHECKING:
    import os
    from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Sequence

    import numpy as np
    from typing_extensions import Self

    from rosidl_py_gen.bags.definition_lookup import Typestore
    from rosidl_py_gen.type_loading.class_lookup import SearchFolders

_END = 1 << 64


class BagReader:
    """A recorded bag. Use it with ``with``.

    Iterating gives a `BagMessage` for each message by log time; `messages` chooses topics and times. Several threads
    may iterate at once, each for itself.

    Args:
        path: an ``.mcap`` or ``.db3`` file, or a rosbag2 folder; also with rosbag2's own zstd compression, of files
            (``.mcap.zstd``, ``.db3.zstd``; they are unpacked into a temporary folder) or of messages. Or the URL of
            one, as ``s3://bucket/drive.mcap``, with the extra ``tables``: MCAP files are then read by ranges.
        validate_crcs: compare the checksum of each chunk of an MCAP file, which for images and clouds takes longer than
            everything else. False is for files you trust; damage is then found only where it breaks the format.
        max_decompressed_bytes: limit for a decompressed chunk or message, 1 GiB by default. Raise it only if the bag
            has larger messages: a few bytes can claim any size.
        search_path: folders with the packages of the recording, for bags that do not have their definitions, as SQLite
            bags before Iron; looked through before AMENT_PREFIX_PATH and the bundled interfaces, as by `get_message`.
        skip_damaged: skip damaged parts of MCAP files and record them in `damaged`; by default they raise `BagError`,
            which names the place, the log times and the topics.
        typestore: the same by name, and first: ``{"my_msgs/msg/Thing": Thing}``, or the text of a definition.

    Raises:
        BagError: damaged beyond reading, or of an unknown kind. OSError: it cannot be opened.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        validate_crcs: bool = True,
        max_decompressed_bytes: int = MAX_UNPACKED_BYTES,
        search_path: SearchFolders = (),
        typestore: Typestore | None = None,
        skip_damaged: bool = False,
    ) -> None:
        self.path = bag_path(path)
        skipped = Skipped()
        self.damaged = skipped.parts
        """Damaged parts of MCAP files that were skipped so far; a `BagWarning` reports each of the first 20."""
        self._kept = ExitStack()
        self.skipped: dict[str, SkippedMessages] = {}
        """Topics whose messages `messages` could not decode and left out so far, with their number and the reason."""
        try:
            skip = skipped.add if skip_damaged else None
            self.files, self._files, hashes = open_files(
                self.path, self._kept, validate_crcs, max_decompressed_bytes, skip
            )
            """The files it consists of."""
            self._definitions = Definitions(self.path, search_path, typestore, hashes)
            self.channels: list[BagTopic] = joined(topic for file in self._files for topic in file.channels())
            """What was recorded: a topic that has messages of two definitions is there twice."""
            self.topics: dict[str, BagTopic] = by_name(self.channels)
            """What was recorded, by name of the topic; of one with several definitions, the first."""
            spans = [span for file in self._files if (span := file.span()) is not None]
            self.start_ns = min((first for first, _ in spans), default=0)
            """Log time of the first message, nanoseconds since 1970; 0 when there is none."""
            self.end_ns = max((last for _, last in spans), default=0)
            """Log time of the last message."""
            self.has_index = all(file.is_whole for file in self._files)
            """False after a crash of the recorder: all of the files is read then to find something."""
            self.unread_bytes = sum(file.unread_bytes for file in self._files)
            """Of records at the end of files that were not finished, as after a crash; a `BagWarning` tells of them."""
            for file, lost in zip(self.files, (one.unread_bytes for one in self._files), strict=True):
                if lost:
                    said = f"{file} breaks off within a record: what its last {lost} bytes hold is lost"
                    warnings.warn(said, BagWarning, stacklevel=2)
        except BaseException:
            self.close()
            raise

    # ------------------------------------------------------------------------------------------------------ reading

    def message_class(self, topic: str | BagTopic) -> type[Any]:
        """The class of a topic's messages: of the definition in the bag, else a local one of that name and hash.

        Where the bag has neither definition nor hash, the first of that name is taken, which a `BagWarning` says once
        for the bag; see `definition`.

        Args:
            topic: a name, or one of `channels`.

        Raises:
            BagError: no such topic, no definition for it anywhere, none with the recorded hash, or several: ask for one
                of `channels` then. DefinitionError: the bag's definition is wrong.
        """
        self.definition(topic)
        channels = [topic] if isinstance(topic, BagTopic) else self._channels_of(topic)
        return next(self._definitions.class_of(one) for one in channels)

    def definition(self, topic: str | BagTopic) -> TopicDefinition:
        """What a topic's messages are decoded with, and whether it certainly is that of the recording.

        Arguments and errors as `message_class`.
        """
        if isinstance(topic, BagTopic):
            return self._definitions.find(topic)
        found = {one.message_class: one for one in map(self._definitions.find, self._channels_of(topic))}
        if len(found) > 1:
            raise BagError(
                f"{self.path}: {topic} was recorded with {len(found)} definitions; `messages` decodes each message "
                "with its own, and this takes one of `channels`"
            )
        return next(iter(found.values()))

    def _channels_of(self, name: str) -> list[BagTopic]:
        if name not in self.topics:
            raise BagError(f"{self.path} has no topic {name}{did_you_mean(name, self.topics)}")
        return [one for one in self.channels if one.name == name]

    def messages(
        self,
        topics: Iterable[str] | str | None = None,
        *,
        start_ns: int | None = None,
        end_ns: int | None = None,
        raw: bool = False,
        arrays: bool = False,
        on_error: Literal["raise", "skip"] = "raise",
    ) -> Iterator[BagMessage]:
        """Messages by log time, each decoded with the definition it was written with.

        Args:
            topics: only these; None means all whose type is known, and all when `raw`. What is left out then is in
                `skipped`, and there is one `BagWarning` for each such topic.
            start_ns: only those with ``start_ns <= log_time``.
            end_ns: only those with ``log_time < end_ns``.
            raw: messages stay bytes of CDR, and cost no decoding.
            arrays: sequences of fixed-size messages become structured arrays, as in `decode`.
            on_error: of a message that is damaged; ``"skip"`` leaves it out as one whose type is not known.

        Raises:
            ValueError: another `on_error`.
            BagError: damaged, no such topic, or one of `topics` cannot be decoded. DecodeError: a message is damaged;
                names the topic and the time.
        """
        if on_error not in ("raise", "skip"):
            raise ValueError(f'on_error is "raise" or "skip", got {on_error!r}')
        names = self._names(topics)
        if raw:
            return with_bytes(self._merged(names, start_ns, end_ns), BagMessage, attrgetter("topic"))
        for name in names or ():
            for one in self._channels_of(name):
                self.message_class(one)
        found = self._merged(names, start_ns, end_ns)
        return self._decoded(found, arrays, names is None, on_error == "skip")

    def raw_messages(
        self,
        topics: Iterable[str] | str | None = None,
        *,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[RawMessage]:
        """The bytes of messages by log time, with the definition that each was written with; as `messages`."""
        found = self._merged(self._names(topics), start_ns, end_ns)
        return with_bytes(found, RawMessage, attrgetter("info"))

    def _names(self, topics: Iterable[str] | str | None) -> list[str] | None:
        names = [topics] if isinstance(topics, str) else None if topics is None else list(topics)
        for name in names or ():
            self._channels_of(name)
        return names

    def _merged(self, names: list[str] | None, start_ns: int | None, end_ns: int | None) -> Iterator[Raw]:
        return merge_by_time(self._files, names, start_ns or 0, _END if end_ns is None else end_ns)

    def _decoded(self, found: Iterable[Raw], arrays: bool, may_leave_out: bool, may_skip: bool) -> Iterator[BagMessage]:
        decoders: dict[BagChannel, Callable[[bytes | memoryview], Any] | None] = {}
        make = tuple.__new__  # what BagMessage() does, in half the time
        for channel, data, log_time, publish_time in found:
            try:
                decode = decoders[channel]
            except KeyError:
                decode = decoders[channel] = self._decoder(channel, data, arrays, may_leave_out, may_skip)
            if decode is None:
                self._leave_out(channel.topic)
                continue
            try:
                message = decode(data)
            except DecodeError as error:
                place = f"{self.path}: {channel.topic} at {log_time} ns: {error.path}"
                told = DecodeError(place, error.offset_bytes, error.reason)
                if not may_skip:
                    raise told from None
                self._leave_out(channel.topic, told)
                continue
            except WrongDefinitionError as error:
                if not may_leave_out:
                    raise WrongDefinitionError(f"{self.path}: {error}") from None
                decoders[channel] = None
                self._leave_out(channel.topic, error)
                continue
            yield make(BagMessage, (channel.topic, message, log_time, publish_time))

    def _decoder(
        self, channel: BagChannel, first: bytes | memoryview, arrays: bool, may_leave_out: bool, may_skip: bool
    ) -> Callable[[bytes | memoryview], Any] | None:
        """None when messages of this channel, of which `first` is one, have to be left out."""
        topic = channel.info
        try:
            cls, found = self._definitions.class_of(topic), self._definitions.find(topic)
            if found.origin == NO_FIELDS and not (found.is_recorded or is_empty(first)):
                raise BagError(f"{channel.topic}: the bag has no definition of {topic.type_name}, and nobody else")
        except RosidlError as error:
            if not may_leave_out:
                raise
            self._leave_out(channel.topic, error, 0)
            return None
        decode = decoder_of(cls, arrays)
        return decode if found.is_recorded else checked_decoder(topic, found, decode, may_skip)

    def _leave_out(self, topic: str, error: RosidlError | None = None, count: int = 1) -> None:
        """Count a message; with the first `error` of a topic, say so."""
        before = self.skipped.get(topic)
        if before is None:
            reason = str(error).removeprefix(f"{topic}: ")
            self.skipped[topic] = SkippedMessages(count, reason)
            warnings.warn(f"{self.path}: left out {topic}: {reason}", BagWarning, stacklevel=4)
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
        """Messages at the times they were recorded, as far apart as then.

        Args:
            rate: 2.0 plays twice as fast; arguments otherwise, and errors, as `messages`.
        """
        return at_recorded_pace(self.messages(topics, start_ns=start_ns, end_ns=end_ns, raw=raw), rate)

    def to_arrays(
        self,
        topic: str,
        fields: Sequence[str] | str | None = None,
        *,
        start_ns: int | None = None,
        end_ns: int | None = None,
        pad: float | str | None = None,
    ) -> np.ndarray[Any, np.dtype[np.void]]:
        """The messages of a topic as a table: a structured array with a row for each.

        Args:
            fields: paths such as ``"header.stamp"``, ``"position[1]"``, ``"ranges[0:10]"``, ``"ranges[:]"``,
                ``"transforms[0].transform"`` or ``"poses[:].position.x"``; None means all numbers and
                texts that are not in arrays. Indices count as Python's. Of a message, all its numbers and texts. Times
                become nanoseconds in int64.
            pad: what rows have in place of elements that a message does not have, such as ``float("nan")`` or 0.

        Returns:
            Columns ``log_time`` (nanoseconds) and the fields, called as their paths. Fixed arrays and parts of known
            length have an axis more. Other sequences are arrays of their own in a column of objects, or, with `pad`, an
            axis as long as the longest. Texts are as long as the longest, or objects where one is far longer.

        Raises:
            BagError: no such topic or field, or one that is of another kind in another definition of this topic; a
                sequence is too short and there is no `pad`, or `pad` is none of the field's type. DecodeError: as
                `messages`.
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
        """The messages of a topic as a `pandas.DataFrame`, with the log times as index, in UTC.

        An array of known length becomes a column for each element, ``orientation_covariance[0]`` and so on.

        Raises:
            ModuleNotFoundError: there is no pandas. Others as `to_arrays`.
        """
        return frame(self.to_arrays(topic, fields, start_ns=start_ns, end_ns=end_ns, pad=pad))

    def batches(
        self,
        topic: str | BagTopic,
        columns: Sequence[str] | str | None = None,
        *,
        start_ns: int | None = None,
        end_ns: int | None = None,
        on_error: Literal["raise", "skip"] = "raise",
        batch_bytes: int = 1 << 21,
    ) -> Any:
        """The messages of a topic as a ``pyarrow.RecordBatchReader``; polars, pandas and DuckDB take it as it is.

        The first columns are ``log_time`` and ``publish_time``; then come the fields, those of nested messages in
        structs. Needs the extra ``tables``.

        Args:
            topic: a name, or one of `channels`, for messages of this definition only.
            columns: paths such as ``"header.stamp"``, which name their columns; None means all fields. Of the other
                fields only the sizes are looked at.
            start_ns: as of `messages`, and so are `end_ns` and `on_error`.
            batch_bytes: a batch has messages of so many bytes, or one that is larger.

        Raises:
            ExtraMissingError: there is no pyarrow. BagError: no such topic or column, definitions of the topic whose
                columns differ, a time or a column that Arrow has no room for; while reading, too. Others as `messages`.
        """
        from rosidl_py_gen.tables.reading import reader

        channels = [topic] if isinstance(topic, BagTopic) else self._channels_of(topic)
        source = self._source([channels[0].name], start_ns, end_ns, on_error)
        return reader(self, channels, columns, source, batch_bytes)

    def _source(
        self, names: list[str], start_ns: int | None, end_ns: int | None, on_error: str, may_leave_out: bool = False
    ) -> TableInput:
        if on_error not in ("raise", "skip"):
            raise ValueError(f'on_error is "raise" or "skip", got {on_error!r}')
        found = as_table_input(self._files, names, start_ns or 0, _END if end_ns is None else end_ns)
        return TableInput(found, lambda some: self._decoded(some, False, may_leave_out, on_error == "skip"))

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
        """The same as a ``pyarrow.Table``, all of it in memory."""
        return self.batches(topic, columns, start_ns=start_ns, end_ns=end_ns, on_error=on_error).read_all()

    # ------------------------------------------------------------------------------------------------------ closing

    def close(self) -> None:
        """Close the files; may be called twice."""
        self._kept.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
