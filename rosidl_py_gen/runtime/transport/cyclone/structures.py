"""What Cyclone keeps to itself: where it lies, and how it is read and changed. The only file that knows.

Decides nothing by a version, the name of a file or an architecture. Each fact is asked of the loaded library, by a
probe: an object that we know is looked at, and what is found has to agree with it. What a probe does not find is None,
and whoever needs it does without, or says why it cannot.

Rules, each with a test:

- Memory is read in three ways: through a pipe (`Peek`), where it may not be there; behind an address that a C function
  has given for it; and where the same kind of object was seen through the pipe before. What is read in the last way is
  compared with what has to be there before anything is changed.
- A table of functions is replaced by a copy that lives for ever: Cyclone drops its references in threads of its own.

Source: docs/internals/dds.md 2.
"""

from __future__ import annotations

import ctypes as ct
import os
import struct
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from rosidl_py_gen.runtime.transport.cyclone.fast_dds import rtps
from rosidl_py_gen.runtime.transport.cyclone.functions import SAMPLE_WITH_DATA, Iov, address_of, pack_iov

if TYPE_CHECKING:
    from typing_extensions import Self

    from rosidl_py_gen.runtime.transport.cyclone.functions import Api

Table: TypeAlias = "ct.Array[ct.c_void_p]"
WORD = ct.sizeof(ct.c_void_p)
TYPE_FUNCTIONS, SAMPLE_FUNCTIONS = 0, WORD
"""Where a type has the addresses of its two tables."""
_TABLE_WORDS, _SLOTS = 17, 20
"""So many functions are copied, and looked for."""
_SAMPLE_KIND, _SAMPLE_TYPE, _TYPE_DOMAIN = 16, 24, 40
_ENTITY_BYTES, _READER_BYTES, _DOMAIN_BYTES = 2048, 1024, 16384
_PAGE = 4096
_CONTENT = bytes.fromhex("00010000") + bytes(range(65, 81))
_fragment = struct.Struct("=Q12xIHH")
"""The packet, where the fragment ends in the message, where submessage and payload begin in the packet."""
_PACKET = 48
_out = struct.Struct("=8xQQi4xQ")
"""Room, size of the submessages, whether there are parameters, the message if there is one; then the iov."""
_OUT_HEAD = 40
_FIRST_OUT, _LAST_OUT = 16, 472
_READER_KIND = (5).to_bytes(4, "little")
_RELIABLE, _WANTS_ALL = 1, 2
_AnyFunction = ct.PYFUNCTYPE(ct.c_void_p, *[ct.c_void_p] * 4)

bytes_at = ct.PYFUNCTYPE(ct.py_object, ct.c_void_p, ct.c_ssize_t)(("PyBytes_FromStringAndSize", ct.pythonapi))
"""`ctypes.string_at` without its Python wrapper."""


class Peek:
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


def is_type(peek: Peek, address: int, name: bytes, version: int) -> bool:
    """Whether a type of that name lies there; `version` stands first in the table of its functions."""
    if address % WORD or address < _PAGE:
        return False
    head = peek.words(address, 8 * WORD)
    if len(head) < 8 or peek.word(head[0]) != version:
        return False
    return any(peek(word, len(name) + 1) == name + b"\0" for word in head[2:])


def find_type(entity: int, name: bytes, version: int) -> int | None:
    """The address of the type of that name, which stands somewhere in an entity."""
    with Peek() as peek:
        words = peek.words(entity, _ENTITY_BYTES)
        return next((word for word in words if is_type(peek, word, name, version)), None)


def find_type_of_domain(neighbour: int, name: bytes, version: int) -> int | None:
    """The same, of a type that the domain of another type has for itself."""
    with Peek() as peek:
        words = peek.words(peek.word(neighbour + _TYPE_DOMAIN), _DOMAIN_BYTES)
        return next((word for word in words if is_type(peek, word, name, version)), None)


def table_at(type_object: int, which: int) -> int:
    """The address of a table of functions."""
    return ct.c_void_p.from_address(type_object + which).value or 0


def copied_table(type_object: int, which: int) -> Table:
    """A copy of it. Some are shorter; what follows them does no harm."""
    with Peek() as peek:
        return (ct.c_void_p * _TABLE_WORDS)(*peek.words(table_at(type_object, which), WORD * _TABLE_WORDS))


def put_table(type_object: int, which: int, table: Table) -> None:
    """Let the type have another table. Whoever calls keeps it for ever."""
    ct.c_void_p.from_address(type_object + which).value = ct.addressof(table)


# -------------------------------------------------------------------------------------------------- tables and samples


class Slots(NamedTuple):
    """Places of functions in the tables, and of the number of references in a sample."""

    from_ser: int
    to_ser_ref: int
    derive_sertype: int
    references: int


def find_slots(api: Api) -> Slots | None:
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
    api.serdata_ref(ct.addressof(blank))
    counted = [4 * index for index, number in enumerate(blank) if number]
    return Slots(*places, *counted) if len(counted) == 1 else None


def references(sample: int, slots: Slots) -> int:
    """How many there are to a sample of ours."""
    return ct.c_uint32.from_address(sample + slots.references).value


def new_sample(api: Api, type_object: int, data: bytes) -> int:
    """A sample with these bytes; 0 when they are none."""
    iov = pack_iov(address_of(data), len(data))
    return api.serdata_from_ser_iov(type_object, SAMPLE_WITH_DATA, 1, iov, len(data)) or 0


def find_content(api: Api, type_object: int) -> int | None:
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


def are_samples_as_known(api: Api, type_object: int, slots: Slots) -> bool:
    """Whether a sample of that type names the type and its functions where they are looked for, and is counted."""
    sample = new_sample(api, type_object, _CONTENT)
    with Peek() as peek:
        counts = []
        for change in (api.serdata_ref, api.serdata_unref, None):
            counts.append(int.from_bytes(peek(sample + slots.references, 4), "little"))
            if change is not None:
                change(sample)
        is_known = (
            counts == [1, 2, 1]
            and peek.word(sample) == peek.word(type_object + SAMPLE_FUNCTIONS)
            and peek.word(sample + _SAMPLE_TYPE) == type_object
            and peek(sample + _SAMPLE_KIND, 1)[0] == SAMPLE_WITH_DATA
        )
    api.serdata_unref(sample)
    return is_known


def content_at(address: int, size: int) -> ct.Array[ct.c_ubyte]:
    """The bytes of a sample as an array; whoever has it keeps the sample."""
    return (ct.c_ubyte * size).from_address(address)


def put_iov(place: int, address: int, size: int) -> None:
    """Say there that the bytes lie elsewhere."""
    ct.memmove(place, pack_iov(address, size), 2 * WORD)


# ------------------------------------------------------------------------------------------------------------- readers


class ReaderPlace(NamedTuple):
    """Where the entity of a reader has the address of the reader of the layer below, and that one its flags."""

    entity: int
    flags: int


def find_reader(entity: int, guid: bytes) -> ReaderPlace | None:
    """Look at a reader that is reliable and transient local, as builtin ones are."""
    with Peek() as peek:
        words = peek.words(entity, _ENTITY_BYTES)
        for place, (history, address) in enumerate(pairwise(words), 1):
            if address < _PAGE or peek(address, 20) != _head_of_reader(guid):
                continue
            inside = peek.words(address, _READER_BYTES)
            for at, (word, flags) in enumerate(zip(inside, inside[2:], strict=False), 2):
                if word == history and flags & 3 == _RELIABLE | _WANTS_ALL:
                    return ReaderPlace(WORD * place, WORD * at)
    return None


def let_want_all(entity: int, place: ReaderPlace, guid: bytes, is_reliable: bool | None) -> str | None:
    """Let a reader want all that writers have, if it is reliable; what is not as known, when something is not.

    Args:
        is_reliable: what it was made to be, if that is known.
    """
    with Peek() as peek:
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


class Packets:
    """Those that were received, and those being made; the first of each is looked at through the pipe."""

    def __init__(self) -> None:
        self._data: int | None = None
        """How far behind the iov a packet being made has the address of its data."""
        self._has_received = False

    def received(self, fragment: int) -> tuple[bytes, int, int, int, int]:
        """What stands before a message, with the 4 bytes it begins with.

        Returns:
            The bytes, the address of the packet, where the submessage and the payload begin in it, and where the
            fragment ends in the message.

        Raises:
            ValueError: it is not as known.
        """
        if self._has_received:
            packet, last, begin, payload = _fragment.unpack(bytes_at(fragment, _fragment.size))
            before = bytes_at(packet + _PACKET, payload + 4)
        else:
            with Peek() as peek:
                packet, last, begin, payload = _fragment.unpack(
                    peek(fragment, _fragment.size).ljust(_fragment.size, b"\0")
                )
                before = peek(packet + _PACKET, payload + 4)
        if before[:4] != b"RTPS":
            raise ValueError(f"no packet: {before[:20].hex()}")
        self._has_received = True
        return before, packet + _PACKET, begin, payload, last

    def announce_parameters(self, iov: int, writer_id: bytes) -> bool:
        """Set the flag in the packet that `iov` belongs to; False when no packet is being made.

        Raises:
            ValueError: it does not look like a packet of that writer.
        """
        if self._data is None:
            with Peek() as peek:
                out = peek(iov - _out.size, _out.size).ljust(_out.size, b"\0")
        else:
            out = bytes_at(iov - _out.size, _out.size)
        room, size, has_parameters, message = _out.unpack(out)
        if message or not rtps.DATA_FRAG_BYTES <= size <= room:
            return False  # no packet is being made: the sample is copied for somebody
        if has_parameters:
            return False  # Cyclone has put some in, for a reader that wants hashes of keys
        if self._data is None:
            with Peek() as peek:
                self._data = find_packet(peek, iov, _OUT_HEAD + size, writer_id)
        if self._data is not None:
            address = ct.c_void_p.from_address(iov + self._data).value or 0
            data = bytes_at(address, _OUT_HEAD + size) if address else b""
            flags = _flags_of_packet(data, writer_id)
            if flags:
                ct.c_ubyte.from_address(address + flags).value |= rtps.HAS_PARAMETERS
                return True
        raise ValueError(out.hex())


def find_packet(peek: Peek, iov: int, size: int, writer_id: bytes) -> int | None:
    """How far behind the iov the address of a packet of that writer stands."""
    for place in range(_FIRST_OUT, _LAST_OUT, WORD):
        address = peek.word(iov + place)
        if address >= _PAGE and _flags_of_packet(peek(address, size), writer_id):
            return place
    return None


def _flags_of_packet(data: bytes, writer_id: bytes) -> int:
    """Where the flags of its last submessage are; 0 when it is no packet of that writer."""
    if len(data) >= _OUT_HEAD + rtps.DATA_BYTES and data[0] == rtps.INFO_SRC and data[24] == rtps.INFO_DST:
        for kind, length in ((rtps.DATA, rtps.DATA_BYTES), (rtps.DATA_FRAG, rtps.DATA_FRAG_BYTES)):
            part = data[-length:]
            if part[0] == kind and part[12:16] == writer_id:
                return len(data) - length + 1
    return 0
