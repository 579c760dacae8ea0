"""Distribution of the recorder of an MCAP file, which rosbag2 writes into metadata records.

Humble writes ``ROS_DISTRO`` at the start of the file; later distributions write the contents of ``metadata.yaml``,
which has ``ros_distro``, at its end (docs/internals/protocol.md 1.9).
"""

from __future__ import annotations

from io import BytesIO
from typing import IO, TYPE_CHECKING

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Metadata
from mcap.writer import MCAP0_MAGIC

from rosidl_py_gen.bags.metadata import distro_of_metadata_text
from rosidl_py_gen.bags.remote import BagUnreachableError
from rosidl_py_gen.bags.storage.mcap_chunks import RECORD

if TYPE_CHECKING:
    from collections.abc import Iterator

_NAME = "rosbag2"
_MAX_RECORDS = 16
"""Maximum number of metadata records to read, and of records at the start of the file."""
_MAX_BYTES = 1 << 20
"""Maximum size of a metadata record to read: 1000 topics take less than half of it."""


def recorded_distro(stream: IO[bytes], size: int) -> str:
    """Return the name of the distribution; empty if no metadata record of the file has it, or they are damaged.

    Raises:
        BagUnreachableError: the file cannot be reached.
    """
    try:
        for body in _metadata_records(stream, size):
            record = Metadata.read(ReadDataStream(BytesIO(body)))
            if record.name != _NAME:
                continue
            distro = record.metadata.get("ROS_DISTRO") or distro_of_metadata_text(
                record.metadata.get("serialized_metadata", "")
            )
            if distro:
                return distro
    except BagUnreachableError:
        raise
    except Exception:  # whatever wrong bytes lead to: the name is of use, but not needed
        return ""
    return ""


def _metadata_records(stream: IO[bytes], size: int) -> Iterator[bytes]:
    """Yield the bodies of the first metadata records: at the start of the file, and those of the index."""
    at = len(MCAP0_MAGIC)
    for _ in range(_MAX_RECORDS):
        opcode, length = _head(stream, at)
        if opcode not in (Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA):
            break
        if opcode == Opcode.METADATA and length <= _MAX_BYTES:
            yield stream.read(length)
        at += RECORD.size + length
    stream.seek(0)
    summary = SeekingReader(stream, record_size_limit=size).get_summary()
    indexes = [one for one in summary.metadata_indexes if one.name == _NAME] if summary else []
    for one in indexes[:_MAX_RECORDS]:
        opcode, length = _head(stream, one.offset)
        if opcode == Opcode.METADATA and length <= _MAX_BYTES:
            yield stream.read(length)


def _head(stream: IO[bytes], at: int) -> tuple[int, int]:
    stream.seek(at)
    head = stream.read(RECORD.size)
    return RECORD.unpack(head) if len(head) == RECORD.size else (0, 0)
