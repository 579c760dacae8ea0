"""What Cyclone keeps to itself: where it lies, and how it is read and changed. The only file that knows.

Decides nothing by a version, the name of a file or an architecture. Each fact is asked of the loaded library, by a
probe: an object that we know is looked at, and what is found has to agree with it. What a probe does not find is None,
and whoever needs it does without, or says why it cannot.

Rules, each with a test:

- Memory is read in three ways: through a pipe (`SafeMemoryReader`), where it may not be there; behind an address
that a C function
  has given for it; and where the same kind of object was seen through the pipe before. What is read in the last way is
  compared with what has to be there before anything is changed.
- A table of functions is replaced by a copy that lives for ever: Cyclone drops its references in threads of its own.

Source: docs/internals/dds.md 2.
"""

from __future__ import annotations

import ctypes as ct
import os
import struct
from contextlib import nullcontext
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from rosidl_py_gen.runtime.transport.cyclone.c_api import SAMPLE_WITH_DATA, Iov, address_of, pack_iov
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop import rtps

if TYPE_CHECKING:
    from typing_extensions import Self

    from rosidl_py_gen.runtime.transport.cyclone.c_api import CycloneApi

Table: TypeAlias = "ct.Array[ct.c_void_p]"
WORD = ct.sizeof(ct.c_void_p)
TYPE_FUNCTIONS, SAMPLE_FUNCTIONS = 0, WORD
"""Where a type has the addresses of its two tables."""
_TABLE_WORDS, _SLOTS = 17, 20
"""So many functions are copied, and looked for."""
_TYPE_DOMAIN = 40
_ENTITY_BYTES, _READER_BYTES, _DOMAIN_BYTES = 2048, 1024, 16384
_PAGE = 4096
_CONTENT = bytes.fromhex("00010000") + bytes(range(65, 81))
_fragment = struct.Struct("=Q16xHH")
"""The packet, and where submessage and payload begin in it."""
_PACKET = 48
_out = struct.Struct("=8xQQi4xQ")
"""Room, size of the submessages, whether there are parameters, the message if there is one; then the iov."""
_OUT_HEAD = 40
_number = struct.Struct("<iI").unpack_from
"""The number of a sample, 15 bytes behind the flags of its submessage."""
_FIRST_OUT, _LAST_OUT = 16, 472
_READER_KIND = (5).to_bytes(4, "little")
_RELIABLE, _WANTS_ALL = 1, 2
_AnyFunction = ct.PYFUNCTYPE(ct.c_void_p, *[ct.c_void_p] * 4)

bytes_at = ct.PYFUNCTYPE(ct.py_object, ct.c_void_p, ct.c_ssize_t)(("PyBytes_FromStringAndSize", ct.pythonapi))
"""`ctypes.string_at` without its Python wrapper."""
_immortal_vtables: dict[tuple[int, int, int | None], Table] = {}
_direct = nullcontext(bytes_at)
"""In the place of a `SafeMemoryReader`, where the same kind of object was seen through one."""


class SafeMemoryReader:
    """Reads memory that may not be there: a system call says so, and nothing ends. For one thread, in a `with` block.

    Where there is no POSIX, it finds nothing.
    """

    def __enter__(self) -> Self:
        self._out, self._in = os.pipe()
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._out)
        os.close(self._in)

    def __call__(self, address: int, size: int) -> bytes:
        """The bytes there, as many of them as there are."""
        found = b""
        while len(found) < size and os.name == "posix":
            begin = address + len(found)
            count = min(size - len(found), _PAGE - begin % _PAGE)  # a page is there as a whole, or not
            try:
                os.write(self._in, (ct.c_char * count).from_address(begin))
            except OSError:
                break
            found += os.read(self._out, count)
        return found

    def words(self, address: int, size: int) -> tuple[int, ...]:
        """The same as numbers of the size of an address."""
        found = self(address, size)
        count = len(found) // WORD
        return struct.unpack(f"={count}{'Q' if WORD == 8 else 'I'}", found[: count * WORD])

    def word(self, address: int) -> int:
        """One of them; 0 when it is not there."""
        return next(iter(self.words(address, WORD)), 0)


# --------------------------------------------------------------------------------------------------------------- types


def is_type(peek: SafeMemoryReader, address: int, name: bytes, version: int) -> bool:
    """Whether a type of that name lies there; `version` stands first in the table of its functions."""
    if address % WORD or address < _PAGE:
        return False
    head = peek.words(address, 8 * WORD)
    if len(head) < 8 or peek.word(head[0]) != version:
        return False
    return any(peek(word, len(name) + 1) == name + b"\0" for word in head[2:])


def probe_sertype(entity: int, name: bytes, version: int) -> int | None:
    """The address of the type of that name, which stands somewhere in an entity."""
    with SafeMemoryReader() as peek:
        words = peek.words(entity, _ENTITY_BYTES)
        return next((word for word in words if is_type(peek, word, name, version)), None)


def find_type_of_domain(neighbour: int, name: bytes, version: int) -> int | None:
    """The same, of a type that the domain of another type has for itself."""
    with SafeMemoryReader() as peek:
        words = peek.words(peek.word(neighbour + _TYPE_DOMAIN), _DOMAIN_BYTES)
        return next((word for word in words if is_type(peek, word, name, version)), None)


def vtable_address(type_object: int, which: int) -> int:
    """The address of a table of functions."""
    return ct.c_void_p.from_address(type_object + which).value or 0


def copy_vtable(type_object: int, which: int) -> Table:
    """A copy of it. Some are shorter; what follows them does no harm."""
    with SafeMemoryReader() as peek:
        return (ct.c_void_p * _TABLE_WORDS)(*peek.words(vtable_address(type_object, which), WORD * _TABLE_WORDS))


def set_vtable(type_object: int, which: int, table: Table) -> None:
    """Let the type have another table. Whoever calls keeps it for ever."""
    ct.c_void_p.from_address(type_object + which).value = ct.addressof(table)


def replace_vtable_function(type_object: int, which: int, slot: int, function: int | None) -> None:
    """Let the type have a copy of its table with another function in that slot; types that shared a table share it."""
    key = vtable_address(type_object, which), slot, function
    table = _immortal_vtables.setdefault(key, copy_vtable(type_object, which))
    table[slot] = function
    set_vtable(type_object, which, table)


# -------------------------------------------------------------------------------------------------- tables and samples


class VtableSlots(NamedTuple):
    """Places of functions in the tables."""

    from_ser: int
    to_ser_ref: int
    derive_sertype: int


def probe_vtable_slots(api: CycloneApi) -> VtableSlots | None:
    """Ask the exported functions which function of a table each of them calls."""
    called: list[tuple[int, int]] = []
    noting = [
        [_AnyFunction(lambda *_, at=(table, slot): called.append(at)) for slot in range(_SLOTS)] for table in range(2)
    ]
    tables = [(ct.c_void_p * _SLOTS)(*(ct.cast(one, ct.c_void_p) for one in row)) for row in noting]
    either, blank = (ct.c_void_p * 64)(*map(ct.addressof, tables)), (ct.c_uint32 * 64)()
    places = []
    for name, second, table in (
        ("ddsi_serdata_from_ser", SAMPLE_WITH_DATA, 1),
        ("ddsi_serdata_to_ser_ref", 0, 0),
        ("ddsi_sertype_derive_sertype", 0, 0),
    ):
        called.clear()
        _AnyFunction((name, api.library))(ct.addressof(either), second, ct.addressof(blank), ct.addressof(blank))
        if len(called) != 1 or called[0][0] != table:
            return None
        places.append(called[0][1])
    return VtableSlots(*places)


def new_sample(api: CycloneApi, type_object: int, data: bytes) -> int:
    """A sample with these bytes; 0 when they are none."""
    iov = pack_iov(address_of(data), len(data))
    return api.serdata_from_ser_iov(type_object, SAMPLE_WITH_DATA, 1, iov, len(data)) or 0


def probe_payload_offset(api: CycloneApi, type_object: int) -> int | None:
    """How far behind the beginning of a sample its bytes lie; None when that is not the same for all samples.

    Asks functions that `replaced` ones stand behind: to be called before these are.
    """
    found = set()
    for data in (_CONTENT, _CONTENT * 40):
        sample, iov = new_sample(api, type_object, data), Iov()
        if not sample:
            return None
        api.serdata_to_ser_ref(sample, 0, len(data), ct.byref(iov))
        if iov.base and bytes_at(iov.base, len(data)) == data and api.serdata_size(sample) == len(data):
            found.add(iov.base - sample)
        else:
            found.add(-1)
        api.serdata_to_ser_unref(sample, ct.byref(iov))
        api.serdata_unref(sample)
    distance = found.pop()
    return distance if not found and 0 < distance < _PAGE else None


def probe_size_offset(api: CycloneApi, type_object: int, content: int) -> int | None:
    """Where a sample says how many bytes follow its first four; None when it is not found, or samples do not have the
    functions of their type.

    Args:
        content: how far behind its beginning its bytes lie.
    """
    places = []
    for data in (_CONTENT, _CONTENT * 40):
        sample = new_sample(api, type_object, data)
        is_known = vtable_address(sample, 0) == vtable_address(type_object, SAMPLE_FUNCTIONS)
        head = struct.unpack(f"={content // 4}I", bytes_at(sample, content // 4 * 4))
        places.append({4 * at for at, number in enumerate(head) if is_known and number == len(data) - 4})
        api.serdata_unref(sample)
    found = places[0] & places[1]
    return found.pop() if len(found) == 1 else None


def hide_sample_tail(api: CycloneApi, sample: int, place: int, count: int) -> bool:
    """Let a sample of ours end so many bytes earlier; False when Cyclone does not say that it does."""
    size, number = api.serdata_size(sample), ct.c_uint32.from_address(sample + place)
    if number.value + 4 != size:
        return False
    number.value -= count
    if api.serdata_size(sample) == size - count:
        return True
    number.value += count
    return False


def payload_array(address: int, size: int) -> ct.Array[ct.c_ubyte]:
    """The bytes of a sample as an array; whoever has it keeps the sample."""
    return (ct.c_ubyte * size).from_address(address)


def write_iovec(place: int, address: int, size: int) -> None:
    """Say there that the bytes lie elsewhere."""
    ct.memmove(place, pack_iov(address, size), 2 * WORD)


# ------------------------------------------------------------------------------------------------------------- readers


class ReaderOffsets(NamedTuple):
    """Where the entity of a reader has the address of the reader of the layer below, and that one its flags."""

    entity: int
    flags: int


def probe_reader_offsets(entity: int, guid: bytes) -> ReaderOffsets | None:
    """Look at a reader that is reliable and transient local, as builtin ones are."""
    with SafeMemoryReader() as peek:
        words = peek.words(entity, _ENTITY_BYTES)
        for place, (history, address) in enumerate(pairwise(words), 1):
            if address < _PAGE or peek(address, 20) != _head_of_reader(guid):
                continue
            inside = peek.words(address, _READER_BYTES)
            for at, (word, flags) in enumerate(zip(inside, inside[2:], strict=False), 2):
                if word == history and flags & 3 == _RELIABLE | _WANTS_ALL:
                    return ReaderOffsets(WORD * place, WORD * at)
    return None


def set_requests_history(entity: int, place: ReaderOffsets, guid: bytes, is_reliable: bool | None) -> str | None:
    """Let a reader want all that writers have, if it is reliable; what is not as known, when something is not.

    Args:
        is_reliable: what it was made to be, if that is known.
    """
    with SafeMemoryReader() as peek:
        reader = peek.word(entity + place.entity)
        found = peek(reader, place.flags + 1)
    if found[:20] != _head_of_reader(guid) or len(found) <= place.flags:
        return f"a reader, {found[:20].hex()}"
    reliable = found[-1] & _RELIABLE
    if is_reliable not in (None, bool(reliable)):
        return f"the flags of a reader, {found[-1]:#x}"
    if reliable:
        ct.c_ubyte.from_address(reader + place.flags).value |= _WANTS_ALL
    return None


def _head_of_reader(guid: bytes) -> bytes:
    """Its kind and its GUID, which is kept as four numbers in the byte order of this machine (little-endian)."""
    return _READER_KIND + b"".join(guid[at : at + 4][::-1] for at in range(0, 16, 4))


# ------------------------------------------------------------------------------------------------------------- packets


class PacketAccess:
    """Those that were received, and those being made; the first of each is looked at through the pipe."""

    def __init__(self) -> None:
        self._data: int | None = None
        """How far behind the iov a packet being made has the address of its data."""
        self._has_received = False

    def read_received(self, fragment: int) -> tuple[bytes, bytes]:
        """What stands before a message: all of the packet up to there, and the last submessage of it.

        Raises:
            ValueError: it is not as known.
        """
        with _direct if self._has_received else SafeMemoryReader() as read:
            found = read(fragment, _fragment.size).ljust(_fragment.size, b"\0")
            packet, begin, payload = _fragment.unpack(found)
            before = read(packet + _PACKET, payload)
        if before[:4] != b"RTPS":
            raise ValueError(f"no packet: {before[:20].hex()}")
        self._has_received = True
        return before, before[begin:]

    def set_inline_qos_flag(self, iov: int, writer_id: bytes) -> bool:
        """Set the flag in the packet that `iov` belongs to; False when no packet is being made.

        Raises:
            ValueError: it does not look like a packet of that writer.
        """
        place = self._data  # which another thread may set meanwhile
        with _direct if place is not None else SafeMemoryReader() as read:
            out = read(iov - _out.size, _out.size).ljust(_out.size, b"\0")
            room, size, has_parameters, message = _out.unpack(out)
            if message or not rtps.DATA_FRAG_BYTES <= size <= room:
                return False  # no packet is being made: the sample is copied for somebody
            if has_parameters:
                return False  # Cyclone has put some in, for a reader that wants hashes of keys
            if isinstance(read, SafeMemoryReader):
                places = find_packet_pointers(read, iov, _OUT_HEAD + size, writer_id)
                place = places[-1] if places else None
                if len(places) == 1:  # of several the next packet tells
                    self._data = place
        if place is not None:
            address = ct.c_void_p.from_address(iov + place).value or 0
            data = bytes_at(address, _OUT_HEAD + size) if address else b""
            flags = _flags_of_packet(data, writer_id)
            if flags:
                ct.c_ubyte.from_address(address + flags).value |= rtps.INLINE_QOS_FLAG
                return True
        raise ValueError(out.hex())


def find_packet_pointers(peek: SafeMemoryReader, iov: int, size: int, writer_id: bytes) -> list[int]:
    """How far behind the iov addresses of packets of that writer stand; that of the newest comes last.

    The one being made has its address in one place. Others are what is left of earlier use of that memory, which may be
    the same address.
    """
    found = []
    for place in range(_FIRST_OUT, _LAST_OUT, WORD):
        address = peek.word(iov + place)
        data = peek(address, size) if address >= _PAGE else b""
        flags = _flags_of_packet(data, writer_id)
        if flags:
            found.append((_number(data, flags + 15), place))
    return [place for _, place in sorted(found)]


def _flags_of_packet(data: bytes, writer_id: bytes) -> int:
    """Where the flags of its last submessage are; 0 when it is no packet of that writer."""
    if len(data) >= _OUT_HEAD + rtps.DATA_BYTES and data[0] == rtps.INFO_SRC and data[24] == rtps.INFO_DST:
        for kind, length in ((rtps.DATA, rtps.DATA_BYTES), (rtps.DATA_FRAG, rtps.DATA_FRAG_BYTES)):
            part = data[-length:]
            if part[0] == kind and part[12:16] == writer_id:
                return len(data) - length + 1
    return 0
