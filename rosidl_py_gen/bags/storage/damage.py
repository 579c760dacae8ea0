"""Damaged parts of an MCAP file: their report, and the search for the next intact chunk.

A reader either raises at the first damaged part, or skips it and reports its topics and times. Chunks have checksums,
so the search looks only for chunks. A candidate must be consistent: the lengths of its record and of its content agree.
A chunk within an MCAP file that is the content of a message is not a candidate: its records lead to the end of that
file, which is before the end of this one.
"""

from __future__ import annotations

import re
import struct
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from rosidl_py_gen.bags.common import BagError, BagWarning, DamagedPart
from rosidl_py_gen.bags.storage.mcap_chunks import RECORD

if TYPE_CHECKING:
    from collections.abc import Collection

    from typing_extensions import Self

    from rosidl_py_gen.bags.storage.mcap_chunks import Read

_HEAD = struct.Struct("<BQQQQII")
"""Start of a chunk record: opcode, length, first and last log time, size, checksum, length of the next name."""
_COMPRESSIONS = (b"", b"lz4", b"zstd")
_MAX_HEAD = _HEAD.size + 4 + 8
_CANDIDATE = re.compile(rb"\x06(?=.{5}\0\0\0)", re.DOTALL)
"""Opcode and length of a chunk that is shorter than 2**40 bytes."""
_MAX_WARNINGS = 20
_WINDOW = 1 << 20
_FIRST_PRIVATE = 0x80
_INDEX = struct.Struct("<BQH")
"""Start of a message index record: opcode, length, channel."""


class DamagedRange(NamedTuple):
    """Damaged range of a file.

    Attributes:
        first, last: log times of its messages; None if not known.
        channels: ids of the channels of its messages; None if not known.
    """

    offset: int
    end: int
    error: BagError
    first: int | None = None
    last: int | None = None
    channels: Collection[int] | None = None


class SkippedParts:
    """Damaged parts that were skipped.

    Attributes:
        parts: the parts, without duplicates.
    """

    def __init__(self) -> None:
        self.parts: list[DamagedPart] = []
        self._known: set[DamagedPart] = set()

    def add(self, part: DamagedPart) -> None:
        """Record a part; the first ones are reported by a `BagWarning` each."""
        if part in self._known:
            return
        self._known.add(part)
        self.parts.append(part)
        count = len(self.parts)
        if count <= _MAX_WARNINGS:
            more = "; further ones are not reported" if count == _MAX_WARNINGS else ""
            text = f"{part.file}: skipped a damaged part, {part.place}: {part.reason}{more}"
            warnings.warn(text, BagWarning, stacklevel=2)


OnDamage = Callable[[DamagedRange], None]
"""Records a damage, or raises `BagError`."""


class ChunkHead(NamedTuple):
    """Start of a chunk record whose lengths agree.

    Attributes:
        end: end of the record, which may be after the end of the file.
    """

    end: int
    first: int
    last: int

    @classmethod
    def at(cls, read: Read, at: int) -> Self | None:
        """Return the start of a chunk record at an offset, whatever its opcode; None if it is not consistent."""
        return cls.within(read(at, _MAX_HEAD), 0, at)

    @classmethod
    def within(cls, data: bytes, start: int, at: int) -> Self | None:
        """Return the start of a chunk record at `start` of `data`, which is `at` in the file; None as for `at`."""
        if len(data) < start + _HEAD.size + 8:
            return None
        _, length, first, last, _, _, name = _HEAD.unpack_from(data, start)
        after = start + _HEAD.size + name
        if name > 4 or len(data) < after + 8 or data[start + _HEAD.size : after] not in _COMPRESSIONS:
            return None
        (stored,) = struct.unpack_from("<Q", data, after)
        if first > last or after + 8 + stored != start + RECORD.size + length:
            return None
        return cls(at + RECORD.size + length, first, last)


def next_chunk(read: Read, at: int, end: int, size: int) -> int:
    """Return the offset of the next chunk of a file of `size` bytes, from `at` on; `end` if there is none before."""
    while at < end:
        window = read(at, min(_WINDOW, end - at) + _MAX_HEAD)
        for match in _CANDIDATE.finditer(window, 0, min(_WINDOW, end - at) + RECORD.size):
            head = ChunkHead.within(window, match.start(), at + match.start())
            if head is None or head.end > size:
                continue
            embedded = _embedding_end(read, head.end, size)
            if not embedded:
                return min(at + match.start(), end)
            at = embedded
            break
        else:
            at += _WINDOW
    return end


def _embedding_end(read: Read, at: int, size: int) -> int:
    """Return the end of an embedded MCAP file whose records continue at `at`; 0 if it is this file."""
    while at + RECORD.size <= size:
        head = read(at, _MAX_HEAD)
        if head.startswith(MCAP0_MAGIC):
            return at + len(MCAP0_MAGIC) if at + len(MCAP0_MAGIC) < size else 0
        opcode, length = RECORD.unpack_from(head)
        if not is_known(opcode) or (opcode == Opcode.CHUNK and ChunkHead.within(head, 0, at) is None):
            return 0  # here the walk searches again, so both take linear time
        at += RECORD.size + length
    return 0


def is_known(opcode: int) -> bool:
    """Return True for the opcodes of MCAP, and for those that MCAP reserves for applications."""
    return 0 < opcode <= max(Opcode) or opcode >= _FIRST_PRIVATE


def indexed_channels(read: Read, at: int, size: int) -> set[int] | None:
    """Return the channels of a chunk whose message indexes begin at `at`; None if there are none."""
    channels = set()
    while at + _INDEX.size <= size:
        opcode, length, channel = _INDEX.unpack(read(at, _INDEX.size))
        if opcode != Opcode.MESSAGE_INDEX or length < 2:
            break
        channels.add(channel)
        at += RECORD.size + length
    return channels or None


def are_zeros(read: Read, at: int, size: int) -> bool:
    """Return True if a file has only zeros from `at` on, as after a power cut, or ends there."""
    return not any(read(start, _WINDOW).strip(b"\0") for start in range(at, size, _WINDOW))
