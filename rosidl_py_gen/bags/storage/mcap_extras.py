"""Records of an MCAP file that are not messages: header, attachments and metadata records.

Records are copied byte by byte, piece by piece, so that an attachment may be larger than memory. Before that they are
checked: a record with a wrong checksum, or with lengths that contradict each other, is damaged.
"""

from __future__ import annotations

import struct
import zlib
from array import array
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from mcap.opcode import Opcode

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.bags.storage.mcap_chunks import BLOCK_BYTES, RECORD

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosidl_py_gen.bags.storage.mcap_chunks import Read

_LENGTH = struct.Struct("<I")
_TIMES = struct.Struct("<QQ")
_SIZE = struct.Struct("<Q")
_MAX_NAME_BYTES = 1 << 20
"""Maximum bytes of a name in a record: the index of a copied file has all names in memory."""
_MAX_CHECKED_BYTES = 1 << 24
"""Maximum size of a metadata record in which each text is checked; a larger record is checked only as a whole."""
_MAX_VALUES_BYTES = 1 << 20
"""Maximum size of a rosbag2 metadata record whose values are read: 1000 topics take less than half of it."""


@dataclass(slots=True)
class OtherRecords:
    """Offsets and counts of the records of a file that are neither messages, schemas nor channels.

    Attributes:
        header: offset of the header; None if there is none.
        attachments, metadata: offsets of these records. They are arrays, as a file may consist of small ones.
        unknown: number of application-specific records outside of chunks.
        unknown_in_chunks: number of application-specific records in each chunk, by the chunk's offset.
    """

    header: int | None = None
    attachments: array[int] = field(default_factory=lambda: array("Q"))
    metadata: array[int] = field(default_factory=lambda: array("Q"))
    unknown: int = 0
    unknown_in_chunks: dict[int, int] = field(default_factory=dict)

    def add(self, opcode: int, at: int) -> None:
        """Register a record outside of chunks, at the offset `at`."""
        if opcode == Opcode.ATTACHMENT:
            self.attachments.append(at)
        elif opcode == Opcode.METADATA:
            self.metadata.append(at)
        elif opcode == Opcode.HEADER and self.header is None:
            self.header = at
        elif opcode > max(Opcode):
            self.unknown += 1


class AttachmentHead(NamedTuple):
    """Description of an MCAP attachment; `size` is the number of bytes of its data."""

    name: str
    media_type: str
    log_time: int
    create_time: int
    size: int


class StoredAttachment(NamedTuple):
    """Attachment of an MCAP file; `pieces` yields the bytes of its complete record."""

    head: AttachmentHead
    pieces: Callable[[], Iterator[bytes]]


class StoredMetadata(NamedTuple):
    """Metadata record of an MCAP file; `pieces` yields the bytes of its complete record, `values` returns its contents.

    `values` raises `BagError` for a record of more than a megabyte.
    """

    name: str
    pieces: Callable[[], Iterator[bytes]]
    values: Callable[[], dict[str, str]]


class _Fields:
    """Reader that returns the fields of an MCAP record, one after the other, up to the end of the record."""

    def __init__(self, read: Read, at: int) -> None:
        head = read(at, RECORD.size)
        if len(head) < RECORD.size:
            raise BagError("a record breaks off")
        self.at = at + RECORD.size
        self.end = self.at + RECORD.unpack(head)[1]
        self._read = read

    def _take(self, size: int) -> bytes:
        if size > self.end - self.at or len(data := self._read(self.at, size)) < size:
            raise BagError("a length in it exceeds it")
        self.at += size
        return data

    def unpack(self, layout: struct.Struct) -> tuple[int, ...]:
        return layout.unpack(self._take(layout.size))

    def text(self) -> str:
        (length,) = self.unpack(_LENGTH)
        if length > _MAX_NAME_BYTES:
            raise BagError(f"a name of {length} bytes; expected at most {_MAX_NAME_BYTES}")
        try:
            return self._take(length).decode()
        except UnicodeDecodeError:
            raise BagError("a text that is not UTF-8") from None

    def skip(self, size: int) -> None:
        if size > self.end - self.at:
            raise BagError("a length in it exceeds it")
        self.at += size

    def pairs(self) -> Iterator[tuple[str, str]]:
        """Yield the keys and values of a map field of an MCAP record; the whole map is read into memory."""
        (length,) = self.unpack(_LENGTH)
        data, at = self._take(length), 0
        while at < length:
            texts = []
            for _ in range(2):
                if at + _LENGTH.size > length:
                    raise BagError("a length in it exceeds it")
                (size,) = _LENGTH.unpack_from(data, at)
                at += _LENGTH.size
                if size > length - at:
                    raise BagError("a length in it exceeds it")
                try:
                    texts.append(data[at : at + size].decode())
                except UnicodeDecodeError:
                    raise BagError("a text that is not UTF-8") from None
                at += size
            yield texts[0], texts[1]


def read_profile(read: Read, at: int) -> str:
    """Return the profile in the MCAP header record at an offset; "" if the record is damaged."""
    try:
        return _Fields(read, at).text()
    except BagError:
        return ""


def read_attachment(read: Read, at: int, validate_crcs: bool) -> StoredAttachment:
    """Return the attachment whose record starts at an offset; raises `BagError` if the record is damaged."""
    fields = _Fields(read, at)
    body = fields.at
    log_time, create_time = fields.unpack(_TIMES)
    name, media_type = fields.text(), fields.text()
    (size,) = fields.unpack(_SIZE)
    fields.skip(size)
    data_end = fields.at
    (expected,) = fields.unpack(_LENGTH)
    if validate_crcs and expected:
        crc = 0
        for piece in _pieces(read, body, data_end):
            crc = zlib.crc32(piece, crc)
        if crc != expected:
            raise BagError(f"the checksum of the attachment {name!r} is wrong")
    head = AttachmentHead(name, media_type, log_time, create_time, size)
    return StoredAttachment(head, lambda: _pieces(read, at, fields.end))


def read_metadata(read: Read, at: int) -> StoredMetadata:
    """Return the metadata record that starts at an offset; raises `BagError` if the record is damaged."""
    fields = _Fields(read, at)
    name, size = fields.text(), fields.end - fields.at
    start = fields.at
    if size <= _MAX_CHECKED_BYTES:
        for _ in fields.pairs():
            pass
    else:
        fields.skip(*fields.unpack(_LENGTH))

    def values() -> dict[str, str]:
        if size > _MAX_VALUES_BYTES:
            raise BagError(f"a metadata record of {size} bytes; expected at most {_MAX_VALUES_BYTES}")
        fields.at = start
        return dict(fields.pairs())

    return StoredMetadata(name, lambda: _pieces(read, at, fields.end), values)


def _pieces(read: Read, at: int, end: int) -> Iterator[bytes]:
    while at < end:
        piece = read(at, min(BLOCK_BYTES, end - at))
        if not piece:
            raise BagError("a record breaks off")
        at += len(piece)
        yield piece
