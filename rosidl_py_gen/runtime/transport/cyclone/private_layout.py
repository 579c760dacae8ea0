"""Offsets in Cyclone's private structures, and functions that read and change these structures.

Each offset is measured by a probe of the loaded library: an object with known content is examined, and exactly one
place must contain this content. Otherwise the probe returns None, and the caller disables its feature.

Memory that may be unmapped is read through a pipe (`SafeMemoryReader`). Memory is read directly at addresses that a C
function returned, and where an object of the same kind was read through the pipe before. In the latter case the content
is compared with expectations before anything is changed.

What each structure is needed for, and what happens without it: docs/internals/cyclone_memory.md 1 to 9.
"""

from __future__ import annotations

import ctypes as ct
import os
import struct
from contextlib import nullcontext
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from rosidl_py_gen.runtime.transport.cyclone.library import SAMPLE_WITH_DATA, CycloneApi, Iov, address_of, pack_iov

if TYPE_CHECKING:
    from collections.abc import Iterable

    from typing_extensions import Self


Vtable: TypeAlias = "ct.Array[ct.c_void_p]"
WORD = ct.sizeof(ct.c_void_p)
TYPE_FUNCTIONS = 0
"""Offset in a sertype (type object of Cyclone) at which the address of the sertype's function table (vtable) is stored.
"""
SAMPLE_FUNCTIONS = WORD
"""Offset in a sertype (type object of Cyclone) at which the address of the function table (vtable) of its samples is
stored."""
_VTABLE_WORDS = 17
"""Number of functions of a vtable that are copied. Some vtables are shorter; the additional words do no harm."""
_PROBED_SLOTS = 20
_TYPE_DOMAIN = 40
"""Offset in a sertype (type object of Cyclone) at which the address of its domain is stored."""
_ENTITY_BYTES = 2048
_READER_BYTES = 1024
_DOMAIN_BYTES = 16384
_PAGE = 4096
_PROBE_SAMPLE = bytes.fromhex("00010000") + bytes(range(65, 81))
DATA = 0x15
"""Number of the RTPS submessage kind DATA; DATA_FRAG, INFO_SRC and INFO_DST are further kinds."""
DATA_FRAG = 0x16
INFO_SRC = 0x0C
INFO_DST = 0x0E
DATA_BYTES = 24
DATA_FRAG_BYTES = 36
INLINE_QOS_FLAG = 2
_received_fragment = struct.Struct("=Q16xHH")
"""Struct layout of the first fields of a received fragment of Cyclone: address of the packet, offsets of submessage and
payload in the packet."""
_RECEIVED_HEAD_BYTES = 48
_packet_head = struct.Struct("=8xQQi4xQ")
"""Struct layout of the fields before the iovec in a packet that Cyclone builds: capacity, size, presence of parameters,
message or null."""
_PACKET_SIZE = 16
"""Offset, in a packet that Cyclone is building, of the field with the size of the submessages."""
_PACKET_DATA_HEAD_BYTES = 40
_sequence_number = struct.Struct("<iI").unpack_from
_SEQUENCE_NUMBER_OFFSET = 15
"""Distance in bytes between the flags of a submessage and the sequence number of its sample."""
_POINTER_OFFSETS = range(16, 472, WORD)
"""Distances from the iovec at which Cyclone may store the address of the data of a packet that is being built."""
_READER_KIND = (5).to_bytes(4, "little")
_RELIABLE_FLAG = 1
_REQUESTS_HISTORY_FLAG = 2
_AnyFunction = ct.PYFUNCTYPE(ct.c_void_p, *[ct.c_void_p] * 4)

bytes_at = ct.PYFUNCTYPE(ct.py_object, ct.c_void_p, ct.c_ssize_t)(("PyBytes_FromStringAndSize", ct.pythonapi))
"""Function that returns a copy of the memory at an address: `ctypes.string_at` without its Python wrapper."""
_immortal_vtables: dict[tuple[int, int, int | None], Vtable] = {}
_direct_reader = nullcontext(bytes_at)
"""Context manager for reading memory directly. It replaces a `SafeMemoryReader` after an object of the same kind was
read through one."""


class SafeMemoryReader:
    """Reader of memory that may be unmapped. For one thread, in a `with` block.

    The reader writes the memory into a pipe: `write` fails with EFAULT where an access would crash the process. Without
    POSIX it reads nothing.
    """

    def __enter__(self) -> Self:
        self._read_end, self._write_end = os.pipe()
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._read_end)
        os.close(self._write_end)

    def __call__(self, address: int, size: int) -> bytes:
        """Return the `size` bytes at an address.

        If some of them are unmapped, the result has only the bytes before the first unmapped byte.
        """
        data = b""
        while len(data) < size and os.name == "posix":
            begin = address + len(data)
            count = min(size - len(data), _PAGE - begin % _PAGE)  # a page is mapped as a whole
            try:
                os.write(self._write_end, (ct.c_char * count).from_address(begin))
            except OSError:
                break
            data += os.read(self._read_end, count)
        return data

    def words(self, address: int, size: int) -> tuple[int, ...]:
        """Return the `size` bytes at an address as integers of pointer size, up to the first unmapped integer."""
        data = self(address, size)
        count = len(data) // WORD
        return struct.unpack(f"={count}{'Q' if WORD == 8 else 'I'}", data[: count * WORD])

    def word(self, address: int) -> int:
        """Return the integer of pointer size at an address; 0 if the memory is unmapped."""
        return next(iter(self.words(address, WORD)), 0)


# --------------------------------------------------------------------------------------------------------------- types
# Type objects (sertypes), their vtables, and the type of type lookups: docs/internals/cyclone_memory.md 3, 4 and 9.


def _find_type(peek: SafeMemoryReader, words: Iterable[int], name: bytes, version: int) -> int | None:
    """Return the first of some words that is the address of the sertype (type object of Cyclone) `name`.

    Returns None if there is none. The vtable of a sertype begins with `version`.
    """
    for address in words:
        # Most words are no pointers: only aligned addresses are followed, through the pipe.
        head = () if address % WORD or address < _PAGE else peek.words(address, 8 * WORD)
        is_type = len(head) == 8 and peek.word(head[0]) == version
        if is_type and any(peek(word, len(name) + 1) == name + b"\0" for word in head[2:]):
            return address
    return None


def probe_sertype(entity: int, name: bytes, version: int) -> int | None:
    """Return the address of the sertype (type object of Cyclone) `name`, to which an entity has a pointer.

    Returns None if not found. `entity` is the address of the entity; the vtable of a sertype begins with `version`.
    """
    with SafeMemoryReader() as peek:
        return _find_type(peek, peek.words(entity, _ENTITY_BYTES), name, version)


def find_type_of_domain(neighbour: int, name: bytes, version: int) -> int | None:
    """Return the address of a builtin sertype (type object of Cyclone) in the domain of the sertype `neighbour`.

    Returns None if not found.
    """
    with SafeMemoryReader() as peek:
        return _find_type(peek, peek.words(peek.word(neighbour + _TYPE_DOMAIN), _DOMAIN_BYTES), name, version)


def vtable_address(type_object: int, which: int) -> int:
    """Return the address of a function table of a sertype; `which` is TYPE_FUNCTIONS or SAMPLE_FUNCTIONS."""
    return ct.c_void_p.from_address(type_object + which).value or 0


def copy_vtable(type_object: int, which: int) -> Vtable:
    """Return a copy of a function table of a sertype; `which` is TYPE_FUNCTIONS or SAMPLE_FUNCTIONS."""
    with SafeMemoryReader() as peek:
        return (ct.c_void_p * _VTABLE_WORDS)(*peek.words(vtable_address(type_object, which), WORD * _VTABLE_WORDS))


def set_vtable(type_object: int, which: int, table: Vtable) -> None:
    """Replace a function table of a sertype. The caller must keep the new table alive until the process ends."""
    ct.c_void_p.from_address(type_object + which).value = ct.addressof(table)


def replace_vtable_function(type_object: int, which: int, slot: int, function: int | None) -> None:
    """Replace a function table of a sertype by a copy in which one function is different.

    The copy is never freed. Sertypes that had the same table get the same copy.
    """
    # Written: the address of the vtable. Cyclone's own vtable is constant memory of the library, and stays as it is.
    key = vtable_address(type_object, which), slot, function
    table = _immortal_vtables.setdefault(key, copy_vtable(type_object, which))
    table[slot] = function
    set_vtable(type_object, which, table)


# -------------------------------------------------------------------------------------------------- tables and samples
# Slots of vtables, payload and size of samples: docs/internals/cyclone_memory.md 2, 4 and 5.


class VtableSlots(NamedTuple):
    """Indexes of the functions that hooks replace in Cyclone's function tables of samples and sertypes."""

    from_ser: int
    to_ser_ref: int
    derive_sertype: int


def probe_vtable_slots(api: CycloneApi) -> VtableSlots | None:
    """Return the indexes of the functions that hooks replace in function tables of Cyclone; None if not found.

    Cyclone is called with a fake object, whose function tables record which function is called.
    """
    called: list[tuple[int, int]] = []
    recorders = [
        [_AnyFunction(lambda *_, at=(table, slot): called.append(at)) for slot in range(_PROBED_SLOTS)]
        for table in range(2)
    ]
    tables = [(ct.c_void_p * _PROBED_SLOTS)(*(ct.cast(one, ct.c_void_p) for one in row)) for row in recorders]
    fake, blank = (ct.c_void_p * 64)(*map(ct.addressof, tables)), (ct.c_uint32 * 64)()
    slots = []
    for name, second, table in (
        ("ddsi_serdata_from_ser", SAMPLE_WITH_DATA, 1),
        ("ddsi_serdata_to_ser_ref", 0, 0),
        ("ddsi_sertype_derive_sertype", 0, 0),
    ):
        called.clear()
        _AnyFunction((name, api.library))(ct.addressof(fake), second, ct.addressof(blank), ct.addressof(blank))
        if len(called) != 1 or called[0][0] != table:
            return None
        slots.append(called[0][1])
    return VtableSlots(*slots)


def new_sample(api: CycloneApi, type_object: int, data: bytes) -> int:
    """Create a sample from serialized bytes; return its address, or 0 if the bytes are not a serialized message."""
    iov = pack_iov(address_of(data), len(data))
    return api.serdata_from_ser_iov(type_object, SAMPLE_WITH_DATA, 1, iov, len(data)) or 0


def probe_payload_offset(api: CycloneApi, type_object: int) -> int | None:
    """Return the offset of the serialized message in samples of a sertype; None if the offset is not constant.

    Calls functions of the sample, so it must be called before they are replaced.
    """
    offsets = set()
    for data in (_PROBE_SAMPLE, _PROBE_SAMPLE * 40):
        sample, iov = new_sample(api, type_object, data), Iov()
        if not sample:
            return None
        api.serdata_to_ser_ref(sample, 0, len(data), ct.byref(iov))
        if iov.base and bytes_at(iov.base, len(data)) == data and api.serdata_size(sample) == len(data):
            offsets.add(iov.base - sample)
        else:
            offsets.add(-1)
        api.serdata_to_ser_unref(sample, ct.byref(iov))
        api.serdata_unref(sample)
    offset = offsets.pop()
    return offset if not offsets and 0 < offset < _PAGE else None


def probe_size_offset(api: CycloneApi, type_object: int, payload_offset: int) -> int | None:
    """Return the offset of the size field in samples of a sertype; None if it is not found.

    The size field is the only word that equals the payload size minus 4 in a small and in a large sample. It is not
    found either if samples do not have the vtable of their sertype.
    """
    candidates = []
    for data in (_PROBE_SAMPLE, _PROBE_SAMPLE * 40):
        sample = new_sample(api, type_object, data)
        is_known = vtable_address(sample, 0) == vtable_address(type_object, SAMPLE_FUNCTIONS)
        head = struct.unpack(f"={payload_offset // 4}I", bytes_at(sample, payload_offset // 4 * 4))
        candidates.append({4 * at for at, number in enumerate(head) if is_known and number == len(data) - 4})
        api.serdata_unref(sample)
    offsets = candidates[0] & candidates[1]
    return offsets.pop() if len(offsets) == 1 else None


def hide_sample_tail(api: CycloneApi, sample: int, size_offset: int, count: int) -> bool:
    """Reduce the size field of a sample by `count` bytes; return False, unchanged, if Cyclone reports another size."""
    # Written: the size. Cyclone frees the sample by its allocated size, which is another field.
    size, number = api.serdata_size(sample), ct.c_uint32.from_address(sample + size_offset)
    if number.value + 4 != size:
        return False
    number.value -= count
    if api.serdata_size(sample) == size - count:
        return True
    number.value += count
    return False


def payload_array(address: int, size: int) -> ct.Array[ct.c_ubyte]:
    """Return the bytes at an address as an array, without a copy. The caller must keep the sample of Cyclone alive."""
    return (ct.c_ubyte * size).from_address(address)


def write_iovec(iov: int, address: int, size: int) -> None:
    """Set address and size of a memory block in the iovec at address `iov`."""
    ct.memmove(iov, pack_iov(address, size), 2 * WORD)


# ------------------------------------------------------------------------------------------------------------- readers
# The flag that makes a reader request early samples: docs/internals/cyclone_memory.md 8.


class ReaderOffsets(NamedTuple):
    """Offsets in private structures of a reader.

    Attributes:
        entity: offset of the DDSI reader's address in the reader entity.
        flags: offset of the flags in the DDSI reader.
    """

    entity: int
    flags: int


def probe_reader_offsets(entity: int, guid: bytes) -> ReaderOffsets | None:
    """Return the offsets in a reader that is reliable and transient local, as builtin readers are; None if not found.

    The address of the DDSI reader leads to the reader kind and the GUID. The word before this address is repeated in
    the DDSI reader, two words before the flags.
    """
    with SafeMemoryReader() as peek:
        words = peek.words(entity, _ENTITY_BYTES)
        for pointer, (previous, address) in enumerate(pairwise(words), 1):
            if address < _PAGE or peek(address, 20) != _head_of_reader(guid):
                continue
            reader = peek.words(address, _READER_BYTES)
            for index, (word, flags) in enumerate(zip(reader, reader[2:], strict=False), 2):
                if word == previous and flags & 3 == _RELIABLE_FLAG | _REQUESTS_HISTORY_FLAG:
                    return ReaderOffsets(WORD * pointer, WORD * index)
    return None


def set_requests_history(entity: int, offsets: ReaderOffsets, guid: bytes, is_reliable: bool | None) -> str | None:
    """Set the flag that makes a reliable reader request the history of writers.

    Args:
        entity: address of the reader entity.
        is_reliable: None if the reliability of the reader is unknown.

    Returns:
        A text about the first unexpected value in memory, after which nothing was changed; else None.
    """
    with SafeMemoryReader() as peek:
        reader = peek.word(entity + offsets.entity)
        data = peek(reader, offsets.flags + 1)
    if data[:20] != _head_of_reader(guid) or len(data) <= offsets.flags:
        return f"a reader, {data[:20].hex()}"
    has_reliable_flag = bool(data[-1] & _RELIABLE_FLAG)
    if is_reliable not in (None, has_reliable_flag):
        return f"the flags of a reader, {data[-1]:#x}"
    if has_reliable_flag:  # written: one bit of the flags, which Cyclone reads while it matches writers
        ct.c_ubyte.from_address(reader + offsets.flags).value |= _REQUESTS_HISTORY_FLAG
    return None


def _head_of_reader(guid: bytes) -> bytes:
    # The GUID is stored as four numbers in the byte order of the machine (little-endian).
    return _READER_KIND + b"".join(guid[at : at + 4][::-1] for at in range(0, 16, 4))


# ------------------------------------------------------------------------------------------------------------- packets
# Sample identities in RTPS packets: docs/internals/cyclone_memory.md 6 and 7.


class PacketAccess:
    """Reader and changer of received RTPS packets and of packets that Cyclone builds, in Cyclone's memory.

    The first packet of each kind is read through the pipe of a `SafeMemoryReader`.
    """

    def __init__(self) -> None:
        self._pointer_offset: int | None = None
        """Distance in bytes from the iovec to the address of the data of a packet that is being built; None if it is
        unknown."""
        self._has_received = False

    def read_received(self, fragment: int) -> tuple[bytes, bytes]:
        """Return the part of a received packet before the payload of a fragment, and the last submessage of this part.

        Raises:
            ValueError: the memory does not contain a packet.
        """
        with _direct_reader if self._has_received else SafeMemoryReader() as read:
            data = read(fragment, _received_fragment.size).ljust(_received_fragment.size, b"\0")
            packet, begin, payload = _received_fragment.unpack(data)
            head = read(packet + _RECEIVED_HEAD_BYTES, payload)
        if head[:4] != b"RTPS":  # the offsets of another version would lead elsewhere
            raise ValueError(f"no packet: {head[:20].hex()}")
        self._has_received = True
        return head, head[begin:]

    def append_inline_qos(self, iov: int, writer_id: bytes, inline_qos: bytes) -> bool:
        """Append inline QoS to the packet that the iovec at address `iov` belongs to.

        The packet ends with the header of the submessage. The address of its data is stored at an unknown distance from
        the iovec. The first time, all words there are tested as pointers; if exactly one leads to a packet of the
        writer, its distance is cached. Later packets are compared before anything is changed.

        Returns:
            False if no packet is being built, or if the packet has parameters already.

        Raises:
            ValueError: the memory does not contain a packet of that writer, or the packet has no room.
        """
        offset = self._pointer_offset  # another thread may set it
        with _direct_reader if offset is not None else SafeMemoryReader() as read:
            head = read(iov - _packet_head.size, _packet_head.size).ljust(_packet_head.size, b"\0")
            capacity, size, has_parameters, message = _packet_head.unpack(head)
            if message or not DATA_FRAG_BYTES <= size <= capacity:
                return False  # no packet: the sample is copied
            if has_parameters:
                return False  # Cyclone has added some for a reader that requests key hashes
            if isinstance(read, SafeMemoryReader):
                offsets = find_packet_pointers(read, iov, _PACKET_DATA_HEAD_BYTES + size, writer_id)
                offset = offsets[-1] if offsets else None
                if len(offsets) == 1:  # otherwise the next packet decides
                    self._pointer_offset = offset
        if offset is not None:
            address = ct.c_void_p.from_address(iov + offset).value or 0
            data = bytes_at(address, _PACKET_DATA_HEAD_BYTES + size) if address else b""
            flags = _find_flags(data, writer_id)
            if flags and size + len(inline_qos) <= capacity:
                # Written in this order: the bytes, the size of the submessages, and the flag that announces the bytes.
                ct.memmove(address + len(data), inline_qos, len(inline_qos))
                ct.c_size_t.from_address(iov - _packet_head.size + _PACKET_SIZE).value = size + len(inline_qos)
                ct.c_ubyte.from_address(address + flags).value |= INLINE_QOS_FLAG
                return True
        raise ValueError(f"unexpected packet head {head.hex()}")


def find_packet_pointers(peek: SafeMemoryReader, iov: int, size: int, writer_id: bytes) -> list[int]:
    """Return the distances from an iovec to addresses of packets of a writer, with the newest packet last.

    The address of the packet that is being built is stored once. Addresses of earlier packets may remain in the memory,
    even several times. They are recognized by a lower sequence number.
    """
    candidates = []
    for offset in _POINTER_OFFSETS:
        address = peek.word(iov + offset)
        data = peek(address, size) if address >= _PAGE else b""
        flags = _find_flags(data, writer_id)
        if flags:
            candidates.append((_sequence_number(data, flags + _SEQUENCE_NUMBER_OFFSET), offset))
    return [offset for _, offset in sorted(candidates)]


def _find_flags(data: bytes, writer_id: bytes) -> int:
    """Return the offset of the flags of the last submessage in a packet; 0 if `data` is not a packet of the writer."""
    if len(data) >= _PACKET_DATA_HEAD_BYTES + DATA_BYTES and data[0] == INFO_SRC and data[24] == INFO_DST:
        for kind, length in ((DATA, DATA_BYTES), (DATA_FRAG, DATA_FRAG_BYTES)):
            submessage = data[-length:]
            if submessage[0] == kind and submessage[12:16] == writer_id:
                return len(data) - length + 1
    return 0
