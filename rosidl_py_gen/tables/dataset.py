"""Bags as Parquet datasets, which pandas, polars, DuckDB and Spark read as one: ``topic=%2Fimu/bag=drive/….parquet``.

Decides what is a file: the messages of one topic of one bag that have one definition, in row groups by time. A bag is
read once for all topics; what waits for its row group is bounded, and the largest is written when it becomes too much.
Images and clouds are left out unless they are asked for: they are bytes that no query looks into.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.bags.storage.storage_api import MessageBlock
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.cdr.typesupport import referenced_classes
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.tables.arrow import pa, parquet
from rosidl_py_gen.tables.columns import free_name, nodes_of
from rosidl_py_gen.tables.output_files import Output, joined
from rosidl_py_gen.tables.reading import BatchBuffer, BatchBuilder

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Collection, Iterator

    from rosidl_py_gen.bags import BagReader, BagTopic

TOPIC, BAG = "topic", "bag"
LARGE_TYPES = {
    *("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"),
    *("sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/PointCloud"),
    *("foxglove_msgs/msg/RawImage", "foxglove_msgs/msg/CompressedImage", "foxglove_msgs/msg/CompressedVideo"),
    *(
        "foxglove_msgs/msg/PointCloud",
        "ffmpeg_image_transport_msgs/msg/FFMPEGPacket",
        "theora_image_transport/msg/Packet",
    ),
}
"""Messages of these types, and of those that have them inside, are large."""
ROW_GROUP_BYTES = 1 << 24
_MAX_FILE_NAME = 255
"""Characters of a name in Linux, macOS and Windows."""
_BATCH_BYTES = 1 << 20
_MOST_WAITING = 1 << 25
"""Bytes of all topics that wait for their row groups."""


@dataclass(frozen=True, slots=True)
class DatasetFile:
    """A file of a dataset.

    Attributes:
        messages: how many rows.
    """

    topic: str
    type_name: str
    path: str
    messages: int


@dataclass(frozen=True, slots=True)
class DatasetReport:
    """What `write_dataset` has done.

    Attributes:
        left_out: topics that were not written, or not wholly, with the reason; those of large messages too.
    """

    files: list[DatasetFile]
    skipped_topics: dict[str, str]


def write_dataset(
    bag: BagReader,
    out: str | os.PathLike[str],
    *,
    name: str | None = None,
    topics: Collection[str] | None = None,
    include_large: bool = False,
    start_ns: int | None = None,
    end_ns: int | None = None,
    on_error: str = "raise",
    overwrite: bool = False,
    compression: str = "zstd",
    row_group_bytes: int = ROW_GROUP_BYTES,
    progress: Callable[[int], None] | None = None,
) -> DatasetReport:
    """Write the topics of a bag as a Parquet dataset, partitioned by topic and bag; several bags may share it.

    Args:
        out: a folder, or a URL that fsspec knows.
        name: of the bag; None is that of its file or folder.
        topics: those to write, also large ones; None is all whose type is known, which leaves out images and clouds.
        include_large: not even those.
        overwrite: files that are there already are replaced.
        row_group_bytes: about so much of Arrow's memory becomes a row group.
        progress: called with the number of messages so far.

    Raises:
        BagError: a file exists already; and as `BagReader.batches`. OSError: it cannot be written.
    """
    made = StagedDataset(bag, str(out), name or bag_name(bag.path.name), overwrite, compression, row_group_bytes)
    with made:
        made.read_bag(topics, include_large, start_ns, end_ns, on_error, progress)
        made.publish()
    return made.report


def _chosen(
    bag: BagReader,
    topics: Collection[str] | None,
    include_large: bool,
    skipped_topics: dict[str, str],
    folder_of: Callable[[str], str],
) -> list[BagTopic]:
    """The channels that are written; says of others why they are not."""
    found = []
    for name in () if topics is None else topics:
        if name not in bag.topics:
            raise BagError(f"{bag.path} has no topic {name}{did_you_mean(name, bag.topics)}")
    for channel in bag.channels:
        if (topics is not None and channel.name not in topics) or channel.count == 0:
            continue
        try:
            cls = bag.message_class(channel)
            nodes_of(cls)
            _require_short(channel.name, folder_of(channel.name))
        except RosidlError as error:
            if topics is not None:
                raise
            skipped_topics[channel.name] = str(error).removeprefix(f"{channel.name}: ")
            continue
        if topics is None and not include_large and is_large(cls):
            skipped_topics[channel.name] = (
                f"{channel.type_name} is large: --include-large (include_large=True) writes it"
            )
            continue
        found.append(channel)
    return found


def _require_short(topic: str, folder: str) -> None:
    if (size := len(TOPIC) + 1 + len(folder)) > _MAX_FILE_NAME:
        found = f"the name of its folder would have {size} characters; expected at most {_MAX_FILE_NAME}"
        raise BagError(f"{topic}: {found}; BagReader.table and bag sql read it from the bag")


def _quoted(name: str) -> str:
    return quote(name, safe="")


def is_large(cls: type[Any]) -> bool:
    """Whether messages of a class are images or clouds, or have some."""
    return not LARGE_TYPES.isdisjoint(referenced_classes(cls))


def bag_name(name: str) -> str:
    """A name without the endings of files of bags."""
    name = name.removesuffix(".zstd")
    return name.removesuffix(".mcap").removesuffix(".db3") or name


class _File:
    """One file, and what waits to be written to it."""

    def __init__(self, path: str, channel: BagTopic, columns: BatchBuilder, batch_bytes: int) -> None:
        self.path, self.channel, self.columns = path, channel, columns
        self.waiting = BatchBuffer(batch_bytes)
        self.batches: list[Any] = []
        self.size = self.rows = 0
        self.writer: Any = None
        self.schema = _renamed(columns.schema)


class StagedDataset:
    """The files of a bag, or of a part of it, which nobody sees before `publish`. Use it with ``with``.

    Args:
        suffix: of the names of files, for one of several parts of a bag.
        folder_of: name of the folder of a topic, without ``topic=``.

    Attributes:
        report: what was done, after `read_bag`.
    """

    def __init__(
        self,
        bag: BagReader,
        out: str,
        name: str,
        overwrite: bool = False,
        compression: str = "zstd",
        row_group_bytes: int = ROW_GROUP_BYTES,
        suffix: str = "",
        folder_of: Callable[[str], str] = _quoted,
    ) -> None:
        self._bag, self._out, self._name, self._suffix, self._folder_of = bag, out, name, suffix, folder_of
        self._overwrite, self._compression, self._most = overwrite, compression, row_group_bytes
        self._output = Output(out)
        self._open = ExitStack()
        self._waiting = 0
        self._by_key: dict[tuple[str, ...], _File] = {}
        self.report = DatasetReport([], {})

    def read_bag(
        self,
        topics: Collection[str] | None,
        include_large: bool,
        start_ns: int | None,
        end_ns: int | None,
        on_error: str,
        progress: Callable[[int], None] | None = None,
    ) -> None:
        """Read the bag; arguments and errors as `write_dataset`."""
        bag, left_out = self._bag, self.report.skipped_topics
        channels = _chosen(bag, topics, include_large, left_out, self._folder_of)
        source = bag._source([*dict.fromkeys(one.name for one in channels)], start_ns, end_ns, on_error, topics is None)
        for channel in channels:
            self._add(channel, BatchBuilder(bag, channel, None, source.decoded))
        done = 0
        for message in source.found if self._by_key else ():
            done += self._take(message)
            if progress is not None:
                progress(done)
        self._end()
        left_out.update({key: one.reason for key, one in bag.skipped.items()})

    def _add(self, channel: BagTopic, columns: BatchBuilder) -> None:
        """Make a file known for the messages of a channel."""
        kind = f"{channel.type_name.rpartition('/')[2]}-{columns.cls._TYPE.hash.removeprefix('RIHS01_')[:8]}"
        folders = f"{TOPIC}={self._folder_of(channel.name)}", f"{BAG}={_quoted(self._name)}"
        path = joined(self._out, *folders, f"{_quoted(kind)}{self._suffix}.parquet")
        same = next((one for one in self._by_key.values() if one.path == path), None)
        self._by_key[channel.key] = same or _File(path, channel, columns, min(_BATCH_BYTES, self._most))

    def _take(self, message: Any) -> int:
        """Take a message or a block; returns of how many messages it is."""
        file = self._by_key.get(message[0].info.key)
        if file is None:
            return 0
        for columns, messages in file.waiting.take(message, {message[0].info.key: file.columns}):
            self._keep(file, columns.batches(messages))
        return len(message.begin) if isinstance(message, MessageBlock) else 1

    def _keep(self, file: _File, batches: Iterator[Any]) -> None:
        for batch in batches:
            file.batches.append(pa.RecordBatch.from_arrays(batch.columns, schema=file.schema))
            file.size += batch.nbytes
            self._waiting += batch.nbytes
            if file.size >= self._most:
                self._write(file)
            while self._waiting > _MOST_WAITING:
                self._write(max(self._by_key.values(), key=lambda one: one.size))

    def _write(self, file: _File) -> None:
        """What waits as a row group."""
        if file.writer is None:
            stream = self._open.enter_context(self._output.written(file.path, self._overwrite))
            file.writer = self._open.enter_context(self._writer(stream, file))
        table = pa.Table.from_batches(file.batches, file.schema)
        try:
            file.writer.write_table(table, row_group_size=max(1, table.num_rows))
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError) as error:
            raise BagError(f"{self._bag.path}: {file.channel.name}: Parquet has no room for it: {error}") from None
        file.rows += table.num_rows
        self._waiting -= file.size
        file.batches, file.size = [], 0

    def _writer(self, stream: Any, file: _File) -> Any:
        return parquet().ParquetWriter(
            stream,
            file.schema,
            compression=self._compression,
            use_dictionary=_texts(file.schema),  # numbers seldom repeat, and looking whether they do takes long
        )

    def _end(self) -> None:
        """Write what waits, and close the files."""
        with self._open:
            for file in self._by_key.values():
                for columns, messages in file.waiting.flush():
                    self._keep(file, columns.batches(messages))
                if file.batches:
                    self._write(file)
        for file in dict.fromkeys(self._by_key.values()):
            if file.rows:
                channel = file.channel
                self.report.files.append(DatasetFile(channel.name, channel.type_name, file.path, file.rows))

    def publish(self) -> None:
        """Give the files their names."""
        self._output.publish()

    def __enter__(self) -> StagedDataset:
        self._output.__enter__()
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        try:
            self._open.__exit__(kind, error, trace)
        finally:
            self._output.__exit__(kind, error, trace)


def _renamed(schema: Any) -> Any:
    """Columns called as the partitions have an underscore behind their names."""
    names = set(schema.names)
    fields = [field.with_name(free_name(field.name, names, (TOPIC, BAG))) for field in schema]
    return pa.schema(fields, metadata=schema.metadata)


def _texts(schema: Any) -> list[str]:
    """The paths of columns of text."""
    found: list[str] = []

    def walk(kind: Any, path: str) -> None:
        if pa.types.is_struct(kind):
            for field in kind:
                walk(field.type, f"{path}.{field.name}")
        elif pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind):
            walk(kind.value_type, f"{path}.list.element")
        elif pa.types.is_string(kind):
            found.append(path)

    for field in schema:
        walk(field.type, field.name)
    return found
