"""Random MCAP files with records of every kind, and their contents, written and read without the product."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import lz4.frame  # type: ignore[import-untyped]
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Channel, Header, Schema
from mcap.stream_reader import StreamReader
from zstandard import ZstdCompressor

if TYPE_CHECKING:
    from pathlib import Path

MAGIC = b"\x89MCAP0\r\n"
COMPRESS = {"": bytes, "zstd": ZstdCompressor().compress, "lz4": lz4.frame.compress}
STRING = b"\0\1\0\0\x03\0\0\0hi\0"
METADATA, ATTACHMENT, CHUNK = 12, 9, 6


def record(opcode: int, *fields: bytes) -> bytes:
    body = b"".join(fields)
    return struct.pack("<BQ", opcode, len(body)) + body


def sized(data: bytes | str) -> bytes:
    data = data.encode() if isinstance(data, str) else data
    return struct.pack("<I", len(data)) + data


def mapped(values: dict[str, str]) -> bytes:
    return sized(b"".join(sized(key) + sized(value) for key, value in values.items()))


def attachment_record(name: str, media_type: str, data: bytes, log_time: int = 1, with_crc: bool = True) -> bytes:
    body = struct.pack("<QQ", log_time, 2) + sized(name) + sized(media_type) + struct.pack("<Q", len(data)) + data
    return record(ATTACHMENT, body, struct.pack("<I", zlib.crc32(body) if with_crc else 0))


def metadata_record(name: str, values: dict[str, str]) -> bytes:
    return record(METADATA, sized(name), mapped(values))


@dataclass
class Contents:
    """Contents of a file. Channels and schemas are tuples without ids."""

    messages: Counter[Any] = field(default_factory=Counter)
    channels: set[Any] = field(default_factory=set)
    schemas: set[Any] = field(default_factory=set)
    attachments: Counter[Any] = field(default_factory=Counter)
    metadata: Counter[Any] = field(default_factory=Counter)
    rosbag2: list[dict[str, str]] = field(default_factory=list)
    profile: str = "ros2"
    private_count: int = 0


class RandomFile:
    """MCAP file of random records, and its contents."""

    def __init__(self, draw: Any, for_sqlite: bool) -> None:
        self._draw, self._for_sqlite = draw, for_sqlite
        self.contents = Contents(profile="ros2" if for_sqlite else draw(st.sampled_from(["ros2", "", "x"])))
        self._index: dict[int, list[bytes]] = {8: [], 10: [], 13: []}
        self._span: list[int] = []
        self._counts: Counter[int] = Counter()
        self._data = bytearray(MAGIC + record(1, sized(self.contents.profile), sized("somebody")))
        self._definitions = self._draw_definitions()
        self._messages = draw(
            st.lists(
                st.tuples(
                    st.sampled_from(sorted(self._channels)),
                    st.sampled_from([0, 1, 1, 42, 2**32 - 1]),
                    st.sampled_from([0, 5, 5, 9, 2**62]),
                    st.sampled_from([0, 5, 9, 2**63 - 1]),
                    st.sampled_from([STRING, b"\0\1\0\0\1\0\0\0\0", b"\0\1\0\0\x05\0\0\0abcd\0"]),
                ),
                max_size=8,
            )
        )
        self._write()

    def _draw_definitions(self) -> list[bytes]:
        draw, contents = self._draw, self.contents
        schemas = {
            1: ("std_msgs/msg/String", "ros2msg", b"string data"),
            2: ("a.Proto", "protobuf", b"\xff\0binary"),
            3: ("j", "jsonschema", b"{}"),
            9: ("pkg/msg/Other", "ros2idl", b"module pkg { module msg { struct Other { string x; }; }; };"),
        }
        numbers = draw(st.lists(st.sampled_from(sorted(schemas)), unique=True))
        definitions = [
            record(3, struct.pack("<H", n), sized(schemas[n][0]), sized(schemas[n][1]), sized(schemas[n][2]))
            for n in numbers
        ]
        contents.schemas = {schemas[number] for number in numbers}
        self._channels: dict[int, Any] = {}
        for number in range(1, draw(st.integers(2, 4))):
            schema = draw(st.sampled_from([0, *numbers]))
            encoding = "cdr" if schema in (1, 9) else draw(st.sampled_from(["cdr", "json"]))
            topic = f"/t{number}" if self._for_sqlite else draw(st.sampled_from(["/a", "/b"]))
            values = draw(
                st.dictionaries(st.sampled_from(["my_key", "offered_qos_profiles", "topic_type_hash"]), st.just(""))
            )
            values = {key: draw(st.sampled_from(["v", "", "ü"])) if key == "my_key" else "" for key in values}
            definitions.append(
                record(4, struct.pack("<HH", number * 7, schema), sized(topic), sized(encoding), mapped(values))
            )
            self._channels[number * 7] = (topic, encoding, tuple(sorted(values.items())), schemas.get(schema))
        contents.channels = set(self._channels.values())
        return definitions

    def _write(self) -> None:
        draw, data = self._draw, self._data
        bare_definitions = draw(st.booleans())
        if bare_definitions:
            data += b"".join(self._definitions)
        else:
            self._add_chunk(self._definitions, [])
        messages = self._messages
        while messages:
            count = draw(st.integers(1, len(messages)))
            self._add_others()
            records = [record(5, struct.pack("<HIQQ", *one[:4]), one[4]) for one in messages[:count]]
            if draw(st.booleans()):
                self._add_chunk(records, messages[:count])
            else:
                data += b"".join(records)
            for one in messages[:count]:
                self.contents.messages[(self._channels[one[0]], *one[1:])] += 1
                self._span.append(one[2])
                self._counts[one[0]] += 1
            messages = messages[count:]
        if draw(st.booleans()):
            self._add_chunk([], [])
        self._add_others()
        data += record(15, bytes(4))
        self._finish()

    def _add_chunk(self, records: list[bytes], messages: list[Any]) -> None:
        private = self._draw(st.integers(0, 1))
        self.contents.private_count += private
        plain = b"".join(records) + record(0x81, b"secret") * private
        name = self._draw(st.sampled_from(sorted(COMPRESS)))
        stored = COMPRESS[name](plain)
        times = [one[2] for one in messages] or [0]
        start = len(self._data)
        crc = zlib.crc32(plain) if self._draw(st.booleans()) else 0
        span = struct.pack("<QQ", min(times), max(times))
        sizes = struct.pack("<QI", len(plain), crc)
        self._data += record(CHUNK, span, sizes, sized(name), struct.pack("<Q", len(stored)), stored)
        length, places, indexes = len(self._data) - start, b"", b""
        if messages and self._draw(st.booleans()):
            at, entries = 0, dict[int, bytes]()
            for one in messages:
                entries[one[0]] = entries.get(one[0], b"") + struct.pack("<QQ", one[2], at)
                at += 9 + 22 + len(one[4])
            for channel, rows in entries.items():
                places += struct.pack("<HQ", channel, len(self._data) + len(indexes))
                indexes += record(7, struct.pack("<H", channel), sized(rows))
        self._data += indexes
        self._index[8].append(
            record(
                8,
                span,
                struct.pack("<QQ", start, length),
                sized(places),
                struct.pack("<Q", len(indexes)),
                sized(name),
                struct.pack("<QQ", len(stored), len(plain)),
            )
        )

    def _add_others(self) -> None:
        """Add attachments, metadata records and private records."""
        draw = self._draw
        for kind in draw(st.lists(st.sampled_from(["attachment", "metadata", "private"]), max_size=3)):
            start = len(self._data)
            if kind == "private":
                self._data += record(draw(st.sampled_from([0x80, 0xFF])), b"private")
                self.contents.private_count += 1
            elif kind == "attachment":
                name, kind_of = draw(st.sampled_from([("a", "text/plain"), ("", ""), ("ä", "x")]))
                content = draw(st.sampled_from([b"", b"data", bytes(100_000)]))
                self._data += attachment_record(name, kind_of, content, with_crc=draw(st.booleans()))
                self.contents.attachments[name, kind_of, 1, 2, content] += 1
                place = struct.pack("<QQQQQ", start, len(self._data) - start, 1, 2, len(content))
                self._index[10].append(record(10, place, sized(name), sized(kind_of)))
            else:
                name = draw(st.sampled_from(["site", "site", ""]))
                values = draw(st.sampled_from([{}, {"robot": "r2"}, {"a": "", "b": "ü"}]))
                self._data += metadata_record(name, values)
                self.contents.metadata[name, tuple(sorted(values.items()))] += 1
                self._index[13].append(record(13, struct.pack("<QQ", start, len(self._data) - start), sized(name)))

    def _finish(self) -> None:
        draw, start = self._draw, len(self._data)
        summary = b""
        if draw(st.booleans()):
            summary += b"".join(self._definitions)
            if draw(st.booleans()):
                span = self._span or [0]
                counts = b"".join(struct.pack("<HQ", *item) for item in sorted(self._counts.items()))
                numbers = struct.pack(
                    "<QHIIIIQQ",
                    len(self._messages),
                    len(self.contents.schemas),
                    len(self._channels),
                    len(self._index[10]),
                    len(self._index[13]),
                    len(self._index[8]),
                    min(span),
                    max(span),
                )
                summary += record(11, numbers, sized(counts))
            for rows in self._index.values():
                summary += b"".join(rows)
        self._data += summary
        self._data += record(2, struct.pack("<QQI", start if summary else 0, 0, 0)) + MAGIC

    @property
    def data(self) -> bytes:
        return bytes(self._data)


@st.composite
def random_files(draw: Any, for_sqlite: bool = False) -> RandomFile:
    return RandomFile(draw, for_sqlite)


def read_contents(path: Path) -> Contents:
    """Return the contents of a file as the package `mcap` reads them, by the index if there is one."""
    contents = Contents()
    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    with path.open("rb") as stream:
        for one in StreamReader(stream, record_size_limit=None).records:
            if isinstance(one, Header):
                contents.profile = one.profile
            elif isinstance(one, Schema):
                schemas[one.id] = one.name, one.encoding, bytes(one.data)
            elif isinstance(one, Channel):
                values = tuple(sorted(one.metadata.items()))
                channels[one.id] = one.topic, one.message_encoding, values, schemas.get(one.schema_id)
    contents.schemas, contents.channels = set(schemas.values()), set(channels.values())
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        for _, channel, message in reader.iter_messages():
            numbers = message.sequence, message.log_time, message.publish_time
            contents.messages[(channels[channel.id], *numbers, message.data)] += 1
        for found in reader.iter_attachments():
            times = found.log_time, found.create_time
            contents.attachments[(found.name, found.media_type, *times, bytes(found.data))] += 1
        for item in reader.iter_metadata():
            if item.name == "rosbag2":
                contents.rosbag2.append(item.metadata)
            else:
                contents.metadata[item.name, tuple(sorted(item.metadata.items()))] += 1
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        counted = summary.statistics
        assert counted.message_count == contents.messages.total()
        assert counted.attachment_count == contents.attachments.total()
        assert counted.metadata_count == contents.metadata.total() + len(contents.rosbag2)
        assert (counted.schema_count, counted.channel_count) == (len(schemas), len(channels))
    return contents
