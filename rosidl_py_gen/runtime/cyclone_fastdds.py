"""Services with Fast DDS peers: the identity of requests and replies, which Cyclone neither shows nor sends.

rmw_fastrtps puts bare messages on the wire and says in RTPS inline parameters whom they belong to. Cyclone reads and
writes no parameters of that kind. But its tables of functions for samples are data: here service topics get copies of
them with some functions replaced by ours.

- Receiving (`from_ser`): the parameters are read from the packet, and the sample becomes one with an identity, as
  `transport.identified` makes it.
- Sending (`to_ser_ref`, for single samples): called while Cyclone makes a packet, whether the first time or to repeat a
  lost one. The parameters go in front of the message, and a flag in the packet says so.

All knowledge of layouts of Cyclone's structures is in this file. Rules, each with a test:

- `_LAYOUTS` names the builds of the library the layouts were read from. With any other, and after the first packet that
  does not look as expected, services of Fast DDS peers are refused; nothing is guessed.
- Replaced functions run in Cyclone's threads, under locks of Cyclone's. They take no lock, call nothing of Cyclone but
  what allocates and copies, log nothing, and never raise.
- They stand in the tables only while a Fast DDS participant may be there, because they add half to the time of a call.
  Cyclone tells of a new participant in its own thread before it takes anything else from it, and that puts them in
  (`notice`); whoever reads discovery takes them out again when it was none of Fast DDS (`settle`).
- They must not run when the interpreter is gone: contexts are closed at exit, which ends all threads of Cyclone.

Source: fastdds.md 3 to 6; protocol.md 5.3.
"""

from __future__ import annotations

import contextlib
import ctypes as ct
import os
import platform
import socket
import struct
import threading
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from rosidl_py_gen.runtime import rtps
from rosidl_py_gen.runtime.transport import FAST_DDS_VENDOR, IDENTITY_BYTES, Lost, identified

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rosidl_py_gen.runtime.cyclone_abi import Api
    from rosidl_py_gen.runtime.transport import DiscoveryEvent, Identity


class _Layout(NamedTuple):
    """Offsets in bytes: of members in structures, and for the tables of functions their index and number."""

    table_words: int = 17
    from_ser: int = 2
    to_ser_ref: int = 7
    to_ser_unref: int = 8
    to_sample: int = 9
    to_untyped: int = 10
    free: int = 12
    sertype_table: int = 8
    fragment_last: int = 20
    fragment_message: int = 24
    packet: int = 48
    out_iov: int = 40
    out_size: int = 16
    out_data: int = 152
    out_head: int = 40


_LAYOUTS = {("Linux", "x86_64", "libddsc-ad12c33a.so.11.0.1"): _Layout()}
"""By system, machine and the name of the library, which in wheels holds a hash of its content: cyclonedds 11.0.1."""

_SAMPLE_WITH_DATA = 2
_BAD_PARAMETER = -3
_two_words = struct.Struct("=QQ")

_Table: TypeAlias = "ct.Array[ct.c_void_p]"
_Ptr, _Size = ct.c_void_p, ct.c_size_t
_FromSer = (_Ptr, _Ptr, ct.c_int, _Ptr, _Size)
_FromSerIov = (_Ptr, _Ptr, ct.c_int, _Size, _Ptr, _Size)
_ToSerRef = (_Ptr, _Ptr, _Size, _Size, _Ptr)
_ToSerUnref = (None, _Ptr, _Ptr)
_ToSample = (ct.c_bool, _Ptr, _Ptr, _Ptr, _Ptr)
_ToUntyped = (_Ptr, _Ptr)
_Free = (None, _Ptr)

_bytes_at = ct.PYFUNCTYPE(ct.py_object, _Ptr, ct.c_ssize_t)(("PyBytes_FromStringAndSize", ct.pythonapi))


def _data_ports(domain_id: int) -> list[int]:
    """Source: protocol.md 10.6."""
    first = 7400 + 250 * domain_id + 11
    ports = []
    for descriptor in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError), socket.socket(fileno=os.dup(int(descriptor))) as own:
            if (own.family, own.type) == (socket.AF_INET, socket.SOCK_DGRAM):
                ports.append(own.getsockname()[1])
    return [port for port in ports if port in range(first, first + 239, 2)]


class FastDds:
    """The replaced functions, and the samples on their way to Fast DDS peers. One for the process; see the head."""

    def __init__(self, library: ct.CDLL) -> None:
        name = PurePath(library._name).name
        system, machine = platform.system(), platform.machine()
        layout = _LAYOUTS.get((system, machine, name))
        self._complained = False
        self.refusal: str | None = None
        """Why services of Fast DDS peers cannot be used; None when they can."""
        if layout is None:
            self.refusal = f"this build of Cyclone DDS is not known: {name} on {system} {machine}"
            layout = _Layout()
        self._layout = layout
        self._library = library
        self._tables: dict[tuple[int, bool], _Table] = {}
        """Tables of functions for request and reply topics, by the address of the table they were copied from."""
        self._send_tables: dict[int, _Table] = {}
        """Tables for single samples with an identity, by the address of the topic's table."""
        self._callbacks: list[object] = []
        self._receivers: list[tuple[_Table, int | None, int | None]] = []
        """Tables with their own function for received samples, and ours."""
        self._lock = threading.Lock()
        """Held while these are exchanged; never during a call into Cyclone."""
        self._unread: set[int] = set()
        """Readers of participants that have something."""
        self._peers: set[tuple[int, bytes]] = set()
        """Participants on Fast DDS, each with the reader that told of it."""
        self._listener_function = ct.CFUNCTYPE(None, ct.c_int32, _Ptr)(self.notice)
        self._outgoing: dict[int, tuple[bytes, int, bytes, Identity]] = {}
        """By address of the sample: parameters and message, where these lie, id of the writer, identity."""
        if self.refusal is None:
            self._new_sample = self._function("ddsi_serdata_from_ser_iov", *_FromSerIov)
            self._unref = self._function("ddsi_serdata_unref", *_Free)
            self._allocate = self._function("dds_alloc", _Ptr, _Size)
            self._write = ct.CFUNCTYPE(ct.c_int, ct.c_int32, _Ptr)(("dds_writecdr", library))

    def _function(self, name: str, *prototype: Any) -> Callable[..., Any]:
        # Short functions that take no lock: they keep the GIL, which is dearer to get back than what they do.
        return ct.PYFUNCTYPE(*prototype)((name, self._library))

    def complaint(self) -> str | None:
        """What to tell the user about Fast DDS peers, once, when there are some whose services cannot be used."""
        if self.refusal is None or self._complained or not self._peers:
            return None
        self._complained = True
        return f"services of Fast DDS nodes cannot be used here, topics can: {self.refusal}"

    def _distrust(self, what: object) -> None:
        self.refusal = f"Cyclone DDS does not behave as known: {what}"

    # -------------------------------------------------------------------------------------------------- topics

    def prepare(self, type_object: int, dds_type: str) -> None:
        """Replace the functions of the type of a request or reply; other types are left alone."""
        is_reply = dds_type.endswith("_Response_")
        if self.refusal is not None or not (is_reply or dds_type.endswith("_Request_")):
            return
        place = _Ptr.from_address(type_object + self._layout.sertype_table)
        original = place.value
        assert original is not None
        table = self._tables.get((original, is_reply))
        if table is None:
            table = self._tables[original, is_reply] = self._copy(original)
            receive = self._receiving(table, is_reply=is_reply)
            with self._lock:
                own, ours = table[self._layout.from_ser], self._pointer(ct.CFUNCTYPE(*_FromSer)(receive))
                self._receivers.append((table, own, ours))
                table[self._layout.from_ser] = ours
            self._send_tables[ct.addressof(table)] = self._sending_table(original)
        place.value = ct.addressof(table)

    def _copy(self, table: int) -> _Table:
        words = self._layout.table_words
        return (_Ptr * words).from_buffer_copy(_bytes_at(table, 8 * words))

    def _pointer(self, callback: Any) -> int | None:
        self._callbacks.append(callback)
        return ct.cast(callback, _Ptr).value

    # -------------------------------------------------------------------------------------------- participants

    def listener(self, api: Api) -> int | None:
        """A listener for a reader of participants; to be deleted once the reader has it. None where there is no use."""
        if self.refusal is not None:
            return None
        listener: int = api.create_listener(None)
        api.lset_data_available_arg(listener, self._listener_function, None, False)
        return listener

    def notice(self, reader: int, _argument: int | None = None) -> None:
        """That reader of participants has something that nobody has looked at yet; maybe one of Fast DDS."""
        with self._lock:
            self._unread.add(reader)
            self._exchange(on=True)

    def look(self, reader: int) -> None:
        """Somebody is going to take all that reader has, and to call `settle` then."""
        with self._lock:
            self._unread.discard(reader)

    def settle(self, reader: int, events: Iterable[DiscoveryEvent]) -> None:
        """Take in what that reader had."""
        with self._lock:
            for event in events:
                if isinstance(event, Lost):
                    self._peers.discard((reader, event.guid))
                elif event.guid.startswith(FAST_DDS_VENDOR):
                    self._peers.add((reader, event.guid))
            if not self._peers and not self._unread:
                self._exchange(on=False)

    def forget(self, reader: int) -> None:
        """That reader is gone."""
        with self._lock:
            self._unread.discard(reader)
            self._peers = {peer for peer in self._peers if peer[0] != reader}

    def _exchange(self, *, on: bool) -> None:
        for table, own, ours in self._receivers:
            table[self._layout.from_ser] = ours if on else own

    def greet(self, domain_id: int, writer_guids: Iterable[bytes]) -> None:
        """Send greetings of these writers to the socket of this process on which the domain's samples arrive."""
        if self.refusal is not None:
            return
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for port in _data_ports(domain_id):
                for guid in writer_guids:
                    out.sendto(rtps.greeting(guid), ("127.0.0.1", port))

    # ------------------------------------------------------------------------------------------------ receiving

    def _receiving(self, table: _Table, *, is_reply: bool) -> Callable[..., Any]:
        layout = self._layout
        plain = ct.PYFUNCTYPE(*_FromSer)(table[layout.from_ser] or 0)
        reference = ct.PYFUNCTYPE(*_ToSerRef)(table[layout.to_ser_ref] or 0)
        give_back = ct.PYFUNCTYPE(*_ToSerUnref)(table[layout.to_ser_unref] or 0)
        new_sample, unref = self._new_sample, self._unref
        last_at, message_at, packet_at = layout.fragment_last, layout.fragment_message, layout.packet

        def receive(type_object: int, kind: int, fragment: int, size: int) -> Any:
            """Make a sample of received fragments."""
            try:
                part = _bytes_at(fragment, 32)
                packet = int.from_bytes(part[:8], "little") + packet_at
                begin = int.from_bytes(part[message_at : message_at + 2], "little")
                payload = int.from_bytes(part[message_at + 2 : message_at + 4], "little")
                submessage = _bytes_at(packet + begin, max(0, payload - begin))
                identity = rtps.read_submessage(_bytes_at(packet, 20), submessage, is_reply=is_reply)
            except Exception as err:  # not to be raised into Cyclone
                self._distrust(f"a received sample, {err!r}")
                identity = None
            if identity is None or kind != _SAMPLE_WITH_DATA or size <= 4 or self.refusal is not None:
                return plain(type_object, kind, fragment, size)
            head = identified(_bytes_at(packet + payload, 4), identity)
            iov = (ct.c_uint64 * 4)(0, len(head), packet + payload + 4, size - 4)
            head_buffer = ct.create_string_buffer(head, len(head))
            iov[0] = ct.addressof(head_buffer)
            if int.from_bytes(part[last_at : last_at + 4], "little") >= size:
                return new_sample(type_object, kind, 2, ct.addressof(iov), size + IDENTITY_BYTES)
            joined = plain(type_object, kind, fragment, size)
            if not joined:
                return joined
            reference(joined, 4, size - 4, ct.addressof(iov) + 16)
            sample = new_sample(type_object, kind, 2, ct.addressof(iov), size + IDENTITY_BYTES)
            give_back(joined, ct.addressof(iov) + 16)
            unref(joined)
            return sample

        return receive

    # -------------------------------------------------------------------------------------------------- sending

    def write(self, entity: int, writer_guid: bytes, type_object: int, data: bytes, identity: Identity) -> int:
        """Send a sample with its identity; returns Cyclone's code, as `dds_write` does.

        Args:
            data: header and message; the length is a multiple of four.
        """
        packed = rtps.parameter_list(identity) + data
        address = ct.cast(ct.c_char_p(packed), _Ptr).value or 0
        iov = (ct.c_uint64 * 2)(address + rtps.PARAMETERS_BYTES, len(data))
        sample = self._new_sample(type_object, _SAMPLE_WITH_DATA, 1, ct.addressof(iov), len(data))
        if not sample:
            return _BAD_PARAMETER
        table = _Ptr.from_address(sample)
        send_table = self._send_tables.get(table.value or 0)
        if send_table is None:
            self._unref(sample)
            self._distrust("a sample made for sending")
            return _BAD_PARAMETER
        self._outgoing[sample] = (packed, address, writer_guid[12:], identity)
        table.value = ct.addressof(send_table)
        code: int = self._write(entity, sample)
        return code

    def _sending_table(self, original: int) -> _Table:
        layout, outgoing = self._layout, self._outgoing
        table = self._copy(original)
        plain = ct.PYFUNCTYPE(*_ToSerRef)(table[layout.to_ser_ref] or 0)
        plain_to_untyped = ct.PYFUNCTYPE(*_ToUntyped)(table[layout.to_untyped] or 0)
        plain_free = ct.PYFUNCTYPE(*_Free)(table[layout.free] or 0)

        def to_ser_ref(sample: int, offset: int, size: int, iov: int) -> Any:
            """Say where the bytes for a packet lie: the first ones with the parameters in front."""
            result = plain(sample, offset or 0, size, iov)
            try:
                if not offset:
                    _, address, writer_id, _identity = outgoing[sample]
                    if self._announce_parameters(iov, writer_id):
                        ct.memmove(iov, _two_words.pack(address, rtps.PARAMETERS_BYTES + size), 16)
            except Exception as err:  # not to be raised into Cyclone
                self._distrust(f"a sample to send, {err!r}")
            return result

        def to_sample(sample: int, container: int, _buffer: int, _limit: int) -> bool:
            """Give the sample to a reader of this process, with its identity."""
            packed, _address, _writer_id, identity = outgoing[sample]
            local = identified(memoryview(packed)[rtps.PARAMETERS_BYTES :], identity)
            copy = self._allocate(len(local))
            ct.memmove(copy, local, len(local))
            ct.memmove(container, _two_words.pack(copy, len(local)), 16)
            return True

        def to_untyped(sample: int) -> Any:
            """The key, with the same functions: Cyclone takes samples with others for another instance, for ever."""
            key = plain_to_untyped(sample)
            if key:
                _Ptr.from_address(key).value = ct.addressof(table)
            return key

        def free(sample: int) -> None:
            """Forget a sample; its address may be used again at once."""
            outgoing.pop(sample, None)
            plain_free(sample)

        table[layout.to_ser_ref] = self._pointer(ct.CFUNCTYPE(*_ToSerRef)(to_ser_ref))
        table[layout.to_sample] = self._pointer(ct.CFUNCTYPE(*_ToSample)(to_sample))
        table[layout.to_untyped] = self._pointer(ct.CFUNCTYPE(*_ToUntyped)(to_untyped))
        table[layout.free] = self._pointer(ct.CFUNCTYPE(*_Free)(free))
        return table

    def _announce_parameters(self, iov: int, writer_id: bytes) -> bool:
        """Set the flag in the packet that `iov` belongs to; False when that does not look like a packet of ours."""
        layout = self._layout
        out = _bytes_at(iov - layout.out_iov, layout.out_data + 8)
        size = int.from_bytes(out[layout.out_size : layout.out_size + 8], "little")
        data = int.from_bytes(out[layout.out_data :], "little")
        if data and rtps.DATA_FRAG_BYTES <= size < 65536:
            head = _bytes_at(data, layout.out_head)
            tail = _bytes_at(data + layout.out_head + size - rtps.DATA_FRAG_BYTES, rtps.DATA_FRAG_BYTES)
            for kind, length in ((rtps.DATA, rtps.DATA_BYTES), (rtps.DATA_FRAG, rtps.DATA_FRAG_BYTES)):
                part = tail[-length:]
                if (
                    part[0] == kind
                    and part[12:16] == writer_id
                    and (head[0], head[24]) == (rtps.INFO_SRC, rtps.INFO_DST)
                ):
                    flags = ct.c_ubyte.from_address(data + layout.out_head + size - length + 1)
                    flags.value |= rtps.HAS_PARAMETERS
                    return True
        self._distrust("a packet to send")
        return False
