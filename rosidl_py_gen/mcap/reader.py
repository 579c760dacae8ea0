"""Reading bags: MCAP files, rosbag2 folders of MCAP or SQLite files, single ``.db3`` files."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import compile_text, get_message
from rosidl_py_gen.errors import DecodeError, RosidlError
from rosidl_py_gen.mcap.common import BagError, BagMessage, BagTopic
from rosidl_py_gen.mcap.decoder import ENCODINGS, decoder_of
from rosidl_py_gen.mcap.metadata import FILE, read_metadata
from rosidl_py_gen.mcap.storage import McapFile, Raw, SqliteFile, Storage, merged
from rosidl_py_gen.mcap.table import table
from rosidl_py_gen.names import did_you_mean

if TYPE_CHECKING:
    import os
    from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Sequence

    import numpy as np
    from typing_extensions import Self

_END = 1 << 63


class BagReader:
    """A recorded bag. Use it with ``with``.

    Iterating gives a `BagMessage` for each message by log time; `messages` chooses topics and times.

    Args:
        path: an ``.mcap`` or ``.db3`` file, or a rosbag2 folder.
        validate_crcs: compare the checksum of each chunk of an MCAP file, which for images and clouds takes longer than
            everything else. False is for files you trust; damage is then found only where it breaks the format.

    Raises:
        BagError: damaged beyond reading, or of an unknown kind. OSError: it cannot be opened.
    """

    def __init__(self, path: str | os.PathLike[str], *, validate_crcs: bool = True) -> None:
        self.path = Path(path)
        self._files: list[Storage] = []
        self._classes: dict[str, type[Any]] = {}
        try:
            self.files = self._paths()
            """The files it consists of."""
            for file in self.files:
                self._files.append(_open(file, validate_crcs))
            self.topics: dict[str, BagTopic] = self._all_topics()
            """What was recorded, by name of the topic."""
            spans = [span for file in self._files if (span := file.span()) is not None]
            self.start_ns = min((first for first, _ in spans), default=0)
            """Log time of the first message, nanoseconds since 1970; 0 when there is none."""
            self.end_ns = max((last for _, last in spans), default=0)
            """Log time of the last message."""
            self.has_index = all(file.is_whole for file in self._files)
            """False after a crash of the recorder: all of the files is read then to find something."""
        except BaseException:
            self.close()
            raise

    def _paths(self) -> list[Path]:
        if not self.path.is_dir():
            return [self.path]
        if not (self.path / FILE).exists():  # the recorder was killed
            found = sorted(file for file in self.path.iterdir() if file.suffix in (".mcap", ".db3"))
            if not found:
                raise BagError(f"{self.path}: a folder with neither {FILE} nor bag files")
            return found
        told = read_metadata(self.path)
        if told.compression and told.compression_mode != "none":
            raise BagError(
                f"{self.path}: {told.compression} of rosbag2's {told.compression_mode} mode is not read; "
                "`ros2 bag convert` without compression_mode makes a bag that is"
            )
        return [self.path / name for name in told.files]

    def _all_topics(self) -> dict[str, BagTopic]:
        found: dict[str, BagTopic] = {}
        for file in self._files:
            for topic in file.topics():
                before = found.get(topic.name)
                found[topic.name] = topic if before is None else _added(before, topic)
        return dict(sorted(found.items()))

    # ------------------------------------------------------------------------------------------------------ reading

    def message_class(self, topic: str) -> type[Any]:
        """The class of a topic's messages: of the definition in the bag, else a local one of that name and hash.

        Raises:
            BagError: no such topic, or no definition for it anywhere. DefinitionError: the bag's definition is wrong.
        """
        cls = self._classes.get(topic)
        if cls is None:
            cls = self._classes[topic] = _class(self._topic(topic))
        return cls

    def _topic(self, name: str) -> BagTopic:
        if name not in self.topics:
            raise BagError(f"{self.path} has no topic {name}{did_you_mean(name, self.topics)}")
        return self.topics[name]

    def messages(
        self,
        topics: Iterable[str] | str | None = None,
        *,
        start_ns: int | None = None,
        end_ns: int | None = None,
        raw: bool = False,
        arrays: bool = False,
    ) -> Iterator[BagMessage]:
        """Messages by log time.

        Args:
            topics: only these; None means all whose type is known, and all when `raw`.
            start_ns: only those with ``start_ns <= log_time``.
            end_ns: only those with ``log_time < end_ns``.
            raw: messages stay bytes of CDR, and cost no decoding.
            arrays: sequences of fixed-size messages become structured arrays, as in `decode`.

        Raises:
            BagError: damaged, or no such topic. DecodeError: a message is damaged; names the topic and the time.
        """
        names = [topics] if isinstance(topics, str) else None if topics is None else list(topics)
        for name in names or ():
            self._topic(name)
        found = merged(self._files, names, start_ns or 0, _END if end_ns is None else end_ns)
        if raw:
            return (BagMessage(topic, bytes(data), logged, published) for topic, data, logged, published in found)
        return self._decoded(found, arrays)

    def _decoded(self, found: Iterable[Raw], arrays: bool) -> Iterator[BagMessage]:
        decoders: dict[str, Callable[[bytes | memoryview], Any]] = {}
        make = tuple.__new__  # what BagMessage() does, in half the time
        for topic, data, log_time, publish_time in found:
            decode = decoders.get(topic)
            if decode is None:
                decode = decoders[topic] = decoder_of(self.message_class(topic), arrays)
            try:
                message = decode(data)
            except DecodeError as error:
                place = f"{self.path}: {topic} at {log_time} ns: {error.path}"
                raise DecodeError(place, error.offset_bytes, error.reason) from None
            yield make(BagMessage, (topic, message, log_time, publish_time))

    def __iter__(self) -> Iterator[BagMessage]:
        return self.messages()

    async def play(
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
        if not rate > 0:
            raise ValueError(f"rate must be above 0, got {rate}")
        clock = asyncio.get_running_loop().time
        began: tuple[float, int] | None = None
        for item in self.messages(topics, start_ns=start_ns, end_ns=end_ns, raw=raw):
            began = began or (clock(), item.log_time)
            await asyncio.sleep(max(0.0, began[0] + (item.log_time - began[1]) / 1e9 / rate - clock()))
            yield item

    def to_arrays(
        self,
        topic: str,
        fields: Sequence[str] | None = None,
        *,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> np.ndarray[Any, np.dtype[np.void]]:
        """The messages of a topic as a table: a structured array with a row for each.

        Args:
            fields: paths such as ``"header.stamp"`` or ``"linear_acceleration.x"``; None means all numbers and strings.
                Fixed arrays become columns with an axis more when they are named. Times become nanoseconds in int64.

        Returns:
            Columns ``log_time`` (nanoseconds) and the fields, called as their paths. `pandas.DataFrame` takes it when
            there are no arrays in it.

        Raises:
            BagError: no such topic or field, or a field that has no fixed size. DecodeError: as `messages`.
        """
        cls = self.message_class(topic)
        return table(cls, self.messages(topic, start_ns=start_ns, end_ns=end_ns), fields, f"{self.path}: {topic}")

    # ------------------------------------------------------------------------------------------------------ closing

    def close(self) -> None:
        """Close the files; may be called twice."""
        for file in self._files:
            file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _open(path: Path, validate_crcs: bool) -> Storage:
    if path.suffix == ".db3":
        return SqliteFile(path)
    if path.suffix == ".mcap":
        return McapFile(path, validate_crcs)
    raise BagError(f"{path}: neither .mcap nor .db3 nor a folder")


def _added(one: BagTopic, two: BagTopic) -> BagTopic:
    from dataclasses import replace

    both = None if one.count is None or two.count is None else one.count + two.count
    return replace(one if one.definition else two, count=both)


def _class(topic: BagTopic) -> type[Any]:
    if topic.message_encoding != "cdr":
        raise BagError(f"{topic.name}: messages are {topic.message_encoding}, not cdr")
    if topic.definition and topic.encoding in ENCODINGS:
        cls = compile_text(topic.type_name, topic.definition)
        if isinstance(cls, type) and hasattr(cls, "decode"):
            return cls
        raise BagError(f"{topic.name}: {topic.type_name} is no message")
    try:
        return get_message(topic.type_name)
    except RosidlError as error:
        raise BagError(f"{topic.name}: the bag has no definition of {topic.type_name}, and {error}") from None
