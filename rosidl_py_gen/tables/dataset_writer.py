"""Writer of bags as a Parquet dataset, which pandas, polars, DuckDB and Spark read as one table.

A file, ``topic=%2Fimu/bag=drive/….parquet`` for example, contains the messages of one topic of one bag with one
definition, in row groups by time. A bag is read once for all topics. The data that waits for its row group is bounded:
when it exceeds the limit, the data of the file with the most is written. Images and clouds are skipped by default, as
no query evaluates their bytes.

Files are written to local folders and, by fsspec, to URLs such as ``s3://`` and ``memory://``. No reader sees a partial
file: all files of one `Output` are renamed when they are complete, and none after a failure. A process that was killed
leaves local files with the suffix ``.partial``.
"""

from __future__ import annotations

import os
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import quote
from uuid import uuid4

from rosidl_py_gen.bags import BagError, BagLocation, MessageBlock
from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.cdr.type_queries import referenced_classes
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.tables.arrow import pa, parquet
from rosidl_py_gen.tables.arrow_columns import free_name, nodes_of
from rosidl_py_gen.tables.reading import BatchBuffer, BatchBuilder

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

    from rosidl_py_gen.bags import BagReader, BagTopic

PARTIAL = ".partial"
_COLONS = "\ue000\ue001"
"""Text that replaces ``::`` in a path while fsspec parses the URL, because fsspec would split the URL there."""
_BLOCK_BYTES = 1 << 23
"""Number of bytes that are sent at once to a remote file."""


def file_system(place: str, *, fresh: bool = False) -> tuple[Any, str]:
    """Return the fsspec file system of a local path or URL, and the path in it.

    `fresh` makes a file system object that is not shared. Raises `BagError` if the URL is not supported, or the place
    does not respond.
    """
    try:
        import fsspec  # type: ignore[import-untyped]
    except ModuleNotFoundError as missing:
        raise Extra.missing_error(missing) or missing from None
    if not BagLocation(place).is_url:  # fsspec would parse "::" as a chain of URLs, and other characters as well
        return fsspec.filesystem("file", skip_instance_cache=fresh), os.path.abspath(place)
    url = place.replace("::", _COLONS) if BagLocation(place).has_colons_in_names else place
    try:
        with BagLocation(place).unreachable_as_error():
            system, path = fsspec.core.url_to_fs(url, skip_instance_cache=fresh)
    except ImportError as error:  # no package for this protocol
        raise BagError(f"{place}: {error}") from None
    return system, path.replace(_COLONS, "::")


def joined(place: str, *parts: str) -> str:
    """Return the local path or URL of the file or folder `parts` below the folder or URL `place`."""
    return "/".join((place.rstrip("/") or "/", *parts)) if BagLocation(place).is_url else os.path.join(place, *parts)


def url_of(place: str, path: str) -> str:
    """Return the URL of a path that fsspec has found at `place`; the path itself if `place` is a local path."""
    if not BagLocation(place).is_url or BagLocation(path).is_url:
        return path
    protocol = place.partition("://")[0]
    return f"{protocol}://{path if protocol == 'file' else path.lstrip('/')}"


class Output:
    """Output files that become visible together by `commit`; leaving the context without `commit` discards them."""

    def __init__(self, out: str) -> None:
        self._system: Any = file_system(out, fresh=True)[0] if BagLocation(out).is_url else None
        self._transaction: Any = None
        self._partial: dict[str, str] = {}
        self._token = uuid4().hex[:12]

    @contextmanager
    def written(self, place: str, may_replace: Callable[[str], bool]) -> Iterator[Any]:
        """Open a binary output file that stays invisible until `commit`, and create its folders.

        Raises:
            BagError: the file exists, and `may_replace` returns False for its place.
            OSError: the file cannot be written.
        """
        if self._system is None:
            if os.path.exists(place) and not may_replace(place):
                raise BagError(f"{place} exists already")
            os.makedirs(os.path.dirname(place) or ".", exist_ok=True)
            self._partial[place] = f"{place}.{self._token}{PARTIAL}"
            with open(self._partial[place], "xb") as stream:
                yield stream
            return
        with BagLocation(place).unreachable_as_error():
            path = file_system(place)[1]
            if self._system.exists(path) and not may_replace(place):
                raise BagError(f"{place} exists already")
            self._system.makedirs(path.rpartition("/")[0], exist_ok=True)
            with self._system.open(path, "wb", block_size=_BLOCK_BYTES) as stream:
                yield stream

    def commit(self) -> None:
        """Rename all output files to their final names."""
        for place, partial in list(self._partial.items()):
            os.replace(partial, place)
            del self._partial[place]
        if self._transaction is not None:
            with BagLocation("the file system").unreachable_as_error():
                transaction, self._transaction = self._transaction, None
                transaction.complete()

    def __enter__(self) -> Output:
        if self._system is not None:
            self._transaction = self._system.transaction
            self._transaction.start()
        return self

    def __exit__(self, *_: object) -> None:
        for partial in self._partial.values():
            with suppress(OSError):
                os.remove(partial)
        if self._transaction is not None:
            with suppress(Exception):  # the first error is raised
                self._transaction.complete(commit=False)


# ------------------------------------------------------------------------------------------------------------- datasets


TOPIC = "topic"
BAG = "bag"
LARGE_TYPES = {
    *(f"sensor_msgs/msg/{name}" for name in ("Image", "CompressedImage", "PointCloud", "PointCloud2")),
    *(f"foxglove_msgs/msg/{name}" for name in ("RawImage", "CompressedImage", "CompressedVideo", "PointCloud")),
    "ffmpeg_image_transport_msgs/msg/FFMPEGPacket",
    "theora_image_transport/msg/Packet",
}
"""Message types that count as large, as do messages that contain them: images, videos and point clouds."""
_MAX_FILE_NAME = 255
"""Maximum characters of a file name in Linux, macOS and Windows."""
BATCH_BYTES = 1 << 20
"""Size in bytes of a topic's collected messages at which they are converted to columns."""
MAX_WAITING_BYTES = 1 << 25
"""Maximum bytes of data of all topics together that is in memory before it is written as row groups."""


@dataclass(frozen=True, slots=True)
class DatasetFile:
    """File that was written to a dataset.

    Attributes:
        messages: number of rows.
    """

    topic: str
    type_name: str
    path: str
    messages: int


@dataclass(frozen=True, slots=True)
class DatasetReport:
    """Result of `write_dataset`.

    Attributes:
        skipped_topics: topics that were not written, or not completely, each with the reason; also topics of large
            messages.
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
    row_group_bytes: int = 16_777_216,
    progress: Callable[[int], None] | None = None,
) -> DatasetReport:
    """Write the topics of a bag as a Parquet dataset, partitioned by topic and bag; several bags may share a dataset.

    Args:
        out: a folder, or a URL that fsspec supports.
        name: name of the bag in the dataset; None means the name of its file or folder.
        topics: topics to write, large ones included; None means all with a known type, except images and clouds.
        include_large: without `topics`, write images and clouds as well.
        start_ns: first log time.
        end_ns: end of the log times, exclusive.
        on_error: ``"skip"`` skips damaged messages; ``"raise"`` raises an error.
        overwrite: replace existing files.
        row_group_bytes: approximate size of a row group in Arrow's memory.
        progress: called with the number of messages so far.

    Raises:
        BagError: a file exists already; otherwise as `BagReader.batches`.
        OSError: the dataset cannot be written.
    """
    dataset = StagedDataset(bag, str(out), name or bag_name(bag.path.name), overwrite, compression, row_group_bytes)
    with dataset:
        dataset.read_bag(topics, include_large, start_ns, end_ns, on_error, progress)
        dataset.commit()
    return dataset.report


def _select_channels(
    bag: BagReader,
    topics: Collection[str] | None,
    include_large: bool,
    skipped_topics: dict[str, str],
    folder_of: Callable[[str], str],
) -> list[BagTopic]:
    """Return the channels of a bag to write, and add the reasons for the other topics to `skipped_topics`."""
    channels = []
    for name in topics or ():
        if name not in bag.topics:
            raise BagError(f"{bag.path} has no topic {name}{did_you_mean(name, bag.topics)}")
    for channel in bag.channels:
        if (topics is not None and channel.name not in topics) or channel.count == 0:
            continue
        try:
            cls = bag.message_class(channel)
            nodes_of(cls)
            if (size := len(f"{TOPIC}={folder_of(channel.name)}")) > _MAX_FILE_NAME:
                problem = f"the name of its folder would have {size} characters; expected at most {_MAX_FILE_NAME}"
                raise BagError(f"{channel.name}: {problem}; BagReader.table and bag sql read it from the bag")
        except RosidlError as error:
            if topics is not None:
                raise
            skipped_topics[channel.name] = str(error).removeprefix(f"{channel.name}: ")
            continue
        if topics is None and not include_large and is_large(cls):
            reason = f"{channel.type_name} is large: --include-large (include_large=True) writes it"
            skipped_topics[channel.name] = reason
            continue
        channels.append(channel)
    return channels


def _quoted(name: str) -> str:
    return quote(name, safe="")


def is_large(cls: type[Any]) -> bool:
    """Return True if messages of a class are images, videos or point clouds, or contain one."""
    return not LARGE_TYPES.isdisjoint(referenced_classes(cls))


def bag_name(name: str) -> str:
    """Return the name of a bag's file or folder without the suffixes of bag files."""
    name = name.removesuffix(".zstd")
    return name.removesuffix(".mcap").removesuffix(".db3") or name


class _File:
    """File of a dataset that is being written, with the data that is collected for its next row group."""

    def __init__(self, path: str, channel: BagTopic, builder: BatchBuilder, batch_bytes: int) -> None:
        self.path, self.channel, self.builder = path, channel, builder
        self.buffer = BatchBuffer(batch_bytes)
        self.batches: list[Any] = []
        self.size = self.rows = 0
        self.writer: Any = None
        names = set(builder.schema.names)
        fields = [field.with_name(free_name(field.name, names, (TOPIC, BAG))) for field in builder.schema]
        self.schema = pa.schema(fields, metadata=builder.schema.metadata)


class StagedDataset:
    """Files of a bag, or of a slice of a bag, that become visible in a dataset together by `commit`; a context manager.

    Args:
        overwrite: True to replace existing files, or a function that returns True for a place to replace.
        suffix: end of the names of files, for one of several slices of a bag.
        folder_of: function that returns the name of the folder of a topic, without ``topic=``.
        metadata_of: function that returns additional metadata of each file, by the number of files.

    Attributes:
        report: result of `read_bag`.
    """

    def __init__(
        self,
        bag: BagReader,
        out: str,
        name: str,
        overwrite: bool | Callable[[str], bool] = False,
        compression: str = "zstd",
        row_group_bytes: int = 16_777_216,
        suffix: str = "",
        folder_of: Callable[[str], str] = _quoted,
        metadata_of: Callable[[int], dict[str, str]] | None = None,
    ) -> None:
        self._bag, self._out, self._name, self._suffix, self._folder_of = bag, out, name, suffix, folder_of
        self._may_replace = overwrite if callable(overwrite) else lambda place: overwrite
        self._compression, self._row_group_bytes, self._metadata_of = compression, row_group_bytes, metadata_of
        self._output = Output(out)
        self._open_files = ExitStack()
        self._waiting_bytes = 0
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
        """Write the topics of the bag to partial files; arguments and errors as in `write_dataset`."""
        bag, skipped = self._bag, self.report.skipped_topics
        channels = _select_channels(bag, topics, include_large, skipped, self._folder_of)
        source = bag._source([*dict.fromkeys(one.name for one in channels)], start_ns, end_ns, on_error, topics is None)
        for channel in channels:
            self._add_file(channel, BatchBuilder(bag, channel, None, source.decoded))
        count = 0
        for message in source.messages_or_blocks if self._by_key else ():
            count += self._add_messages(message)
            if progress is not None:
                progress(count)
        self._finish()
        skipped.update({key: one.reason for key, one in bag.skipped.items()})

    def _add_file(self, channel: BagTopic, builder: BatchBuilder) -> None:
        kind = f"{channel.type_name.rpartition('/')[2]}-{builder.cls._TYPE.hash.removeprefix('RIHS01_')[:8]}"
        folders = f"{TOPIC}={self._folder_of(channel.name)}", f"{BAG}={_quoted(self._name)}"
        path = joined(self._out, *folders, f"{_quoted(kind)}{self._suffix}.parquet")
        same = next((one for one in self._by_key.values() if one.path == path), None)
        self._by_key[channel.key] = same or _File(path, channel, builder, min(BATCH_BYTES, self._row_group_bytes))

    def _add_messages(self, message: Any) -> int:
        """Add a message, or a block of messages, to the dataset file of its topic; return the number of messages."""
        file = self._by_key.get(message[0].info.key)
        if file is None:
            return 0
        for builder, messages in file.buffer.take(message, {message[0].info.key: file.builder}):
            self._add_batches(file, builder.batches(messages))
        return len(message.begin) if isinstance(message, MessageBlock) else 1

    def _add_batches(self, file: _File, batches: Iterator[Any]) -> None:
        for batch in batches:
            file.batches.append(pa.RecordBatch.from_arrays(batch.columns, schema=file.schema))
            file.size += batch.nbytes
            self._waiting_bytes += batch.nbytes
            if file.size >= self._row_group_bytes:
                self._write(file)
            while self._waiting_bytes > MAX_WAITING_BYTES:
                self._write(max(self._by_key.values(), key=lambda one: one.size))

    def _write(self, file: _File) -> None:
        if file.writer is None:
            stream = self._open_files.enter_context(self._output.written(file.path, self._may_replace))
            writer = parquet().ParquetWriter(
                stream,
                file.schema,
                compression=self._compression,
                use_dictionary=_text_paths(file.schema),  # numbers seldom repeat, and checking them takes long
            )
            file.writer = self._open_files.enter_context(writer)
        table = pa.Table.from_batches(file.batches, file.schema)
        try:
            file.writer.write_table(table, row_group_size=max(1, table.num_rows))
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError) as error:
            raise BagError(f"{self._bag.path}: {file.channel.name}: Parquet cannot store it: {error}") from None
        file.rows += table.num_rows
        self._waiting_bytes -= file.size
        file.batches, file.size = [], 0

    def _finish(self) -> None:
        with self._open_files:
            for file in self._by_key.values():
                for builder, messages in file.buffer.flush():
                    self._add_batches(file, builder.batches(messages))
                if file.batches:
                    self._write(file)
            files = [file for file in dict.fromkeys(self._by_key.values()) if file.rows]
            if self._metadata_of is not None:
                for file in files:
                    file.writer.add_key_value_metadata(self._metadata_of(len(files)))
        for file in files:
            channel = file.channel
            self.report.files.append(DatasetFile(channel.name, channel.type_name, file.path, file.rows))

    def commit(self) -> None:
        """Rename the partial files to their final names, so that readers see all of them."""
        self._output.commit()

    def __enter__(self) -> StagedDataset:
        self._output.__enter__()
        return self

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        try:
            self._open_files.__exit__(kind, error, trace)
        finally:
            self._output.__exit__(kind, error, trace)


def _text_paths(schema: Any) -> list[str]:
    paths: list[str] = []

    def walk(kind: Any, path: str) -> None:
        if pa.types.is_struct(kind):
            for field in kind:
                walk(field.type, f"{path}.{field.name}")
        elif pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind):
            walk(kind.value_type, f"{path}.list.element")
        elif pa.types.is_string(kind):
            paths.append(path)

    for field in schema:
        walk(field.type, field.name)
    return paths
