"""Services with Fast DDS peers: the identity of requests and replies, which Cyclone neither shows nor sends.

rmw_fastrtps puts bare messages on the wire and says in RTPS inline parameters whom they belong to. Cyclone reads and
writes no parameters of that kind. But its tables of functions for samples are data: here service topics get copies of
them with some functions replaced by ours.

- Receiving (`from_ser`): the parameters are read from the packet, and the sample becomes one with an identity, as
  `correlation.identified` makes it.
- Sending (`to_ser_ref`): called while Cyclone makes a packet, whether the first time or to repeat a lost one. The
  parameters go in front of the message, and a flag in the packet says so. Readers of this process need no packet and
  get the identity in `to_sample`.

All offsets in Cyclone's structures are in this file; `catchup.py` uses two of them. Rules, each with a test:

- `_LAYOUTS` names the builds of the library the layouts were read from. With any other, and after the first packet that
  does not look as expected, services of Fast DDS peers are refused; nothing is guessed.
- Replaced functions run in Cyclone's threads, under locks of Cyclone's. They take no lock, call nothing of Cyclone but
  what allocates and copies, log nothing, and never raise.
- They stand in the tables only while a Fast DDS participant may be there, because they add half to the time of a call.
  Cyclone tells of a new participant in its own thread before it takes anything else from it, and that puts them in
  (`notice`); whoever reads discovery takes them out again when it was none of Fast DDS (`settle`).
- They must not run when the interpreter is gone: contexts are closed at exit, which ends all threads of Cyclone.

Source: docs/internals/dds.md 2 to 5; docs/internals/protocol.md 5.3.
"""

from __future__ import annotations

import ctypes as ct
import platform
import struct
import threading
from collections import deque
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from rosidl_py_gen.runtime.transport.cyclone import abi, rtps
from rosidl_py_gen.runtime.transport.dds.correlation import FAST_DDS_VENDOR, IDENTITY_BYTES, identified
from rosidl_py_gen.runtime.transport.discovered import Lost

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rosidl_py_gen.runtime.transport.dds.correlation import Identity
    from rosidl_py_gen.runtime.transport.discovered import DiscoveryEvent


class _Layout(NamedTuple):
    """Offsets in bytes, and for the tables of functions their index and number; members read together in one go."""

    table_words: int = 17
    from_ser: int = 2
    to_ser_ref: int = 7
    to_ser_unref: int = 8
    to_sample: int = 9
    references: int = 12
    sertype_table: int = 8
    fragment: struct.Struct = struct.Struct("=Q12xIHH")
    """The packet, where the fragment ends in the message, where submessage and payload begin in the packet."""
    packet: int = 48
    out_iov: int = 40
    out: struct.Struct = struct.Struct("=8xQQi4xQ112xQ")
    """Room, size of the submessages, whether there are parameters, the message if there is one, the data."""
    out_head: int = 40
    entity_reader: int = 632
    reader_flags: int = 256


_LAYOUTS = {("Linux", "x86_64", "libddsc-ad12c33a.so.11.0.1"): _Layout()}
"""By system, machine and the name of the library, which in wheels holds a hash of its content: cyclonedds 11.0.1."""

_SAMPLE_WITH_DATA = 2
_BAD_PARAMETER = -3
_two_words, _four_words = struct.Struct("=QQ").pack, struct.Struct("=QQQQ").pack
_PATIENCE = 4
"""See `FastDds.sweep`."""

_Table: TypeAlias = "ct.Array[ct.c_void_p]"
_Ptr, _Size = ct.c_void_p, ct.c_size_t
_FromSer = (_Ptr, _Ptr, ct.c_int, _Ptr, _Size)
_FromSerIov = (_Ptr, _Ptr, ct.c_int, _Size, _Ptr, _Size)
_ToSerRef = (_Ptr, _Ptr, _Size, _Size, _Ptr)
_ToSerUnref = (None, _Ptr, _Ptr)
_ToSample = (ct.c_bool, _Ptr, _Ptr, _Ptr, _Ptr)
_Unref = (None, _Ptr)
_TwoIov = ct.c_uint64 * 4

_address_of = ct.PYFUNCTYPE(_Ptr, ct.py_object)(("PyBytes_AsString", ct.pythonapi))
_ensure_thread_state = ct.PYFUNCTYPE(ct.c_int)(("PyGILState_Ensure", ct.pythonapi))
_bytes_at = ct.PYFUNCTYPE(ct.py_object, _Ptr, ct.c_ssize_t)(("PyBytes_FromStringAndSize", ct.pythonapi))


class _Threads(threading.local):
    """Threads of Cyclone's in which a sample was looked into.

    Python makes its state of a foreign thread anew for each call, which takes longer than the call (a service call from
    rclpy: 363 us, with the state kept 294). One more reference keeps it; what it takes stays until the process ends.
    """

    is_known = False


_thread = _Threads()


class _Outgoing(NamedTuple):
    """A sample with an identity that Cyclone may still send, or send again."""

    packed: bytes
    """Parameters and message."""
    address: int
    """Where these lie."""
    writer_id: bytes
    identity: Identity


class _Samples:
    """The functions for samples of requests, or of replies: a copy of Cyclone's table, with ours in it."""

    def __init__(self, owner: FastDds, original: int, *, is_reply: bool) -> None:
        layout = self._layout = owner.layout
        self._owner = owner
        self._is_reply = is_reply
        self.table: _Table = (_Ptr * layout.table_words).from_buffer_copy(_bytes_at(original, 8 * layout.table_words))
        self._plain_receive = ct.PYFUNCTYPE(*_FromSer)(self.table[layout.from_ser] or 0)
        self._plain_to_ser_ref = ct.PYFUNCTYPE(*_ToSerRef)(self.table[layout.to_ser_ref] or 0)
        self._give_back = ct.PYFUNCTYPE(*_ToSerUnref)(self.table[layout.to_ser_unref] or 0)
        self._plain_to_sample = ct.PYFUNCTYPE(*_ToSample)(self.table[layout.to_sample] or 0)
        self._receive_function = ct.CFUNCTYPE(*_FromSer)(self._receive)
        self._to_ser_ref_function = ct.CFUNCTYPE(*_ToSerRef)(self._to_ser_ref)
        self._to_sample_function = ct.CFUNCTYPE(*_ToSample)(self._to_sample)
        self._receivers = (self.table[layout.from_ser], ct.cast(self._receive_function, _Ptr).value)
        self.sends = False
        """Whether samples with an identity were written. From then on taking samples calls a function of ours."""

    def look_into_received(self, look: bool) -> None:
        """Whether received samples are looked into."""
        self.table[self._layout.from_ser] = self._receivers[look]

    def prepare_sending(self) -> None:
        """To be called before a sample with an identity is written."""
        self.sends = True
        self.table[self._layout.to_ser_ref] = ct.cast(self._to_ser_ref_function, _Ptr).value
        self.table[self._layout.to_sample] = ct.cast(self._to_sample_function, _Ptr).value

    def _receive(self, type_object: int, kind: int, fragment: int, size: int) -> Any:
        """Make a sample of received fragments."""
        owner, layout = self._owner, self._layout
        if not _thread.is_known:
            _thread.is_known = True
            _ensure_thread_state()
        try:
            packet, last, begin, payload = layout.fragment.unpack(_bytes_at(fragment, layout.fragment.size))
            packet += layout.packet
            # All of the packet up to the message, and its encapsulation header.
            before = _bytes_at(packet, payload + 4)
            identity = rtps.read_submessage(before, before[begin:payload], is_reply=self._is_reply)
        except Exception as err:  # not to be raised into Cyclone
            owner.distrust(f"a received sample, {err!r}")
            identity = None
        if identity is None or kind != _SAMPLE_WITH_DATA or size <= 4 or owner.refusal is not None:
            return self._plain_receive(type_object, kind, fragment, size)
        head = identified(before[payload:], identity)
        if last >= size:
            iov = _four_words(_address_of(head), len(head), packet + payload + 4, size - 4)
            return owner.new_sample(type_object, kind, 2, iov, size + IDENTITY_BYTES)
        joined = self._plain_receive(type_object, kind, fragment, size)
        if not joined:
            return joined
        parts = _TwoIov(_address_of(head), len(head))
        rest = ct.addressof(parts) + 16
        self._plain_to_ser_ref(joined, 4, size - 4, rest)
        sample = owner.new_sample(type_object, kind, 2, parts, size + IDENTITY_BYTES)
        self._give_back(joined, rest)
        owner.unref(joined)
        return sample

    def _to_ser_ref(self, sample: int, offset: int | None, size: int, iov: int) -> Any:
        """Say where the bytes for a packet lie: the first ones with the parameters in front."""
        result = self._plain_to_ser_ref(sample, offset or 0, size, iov)
        if not offset:
            outgoing = self._owner.outgoing.get(sample)
            if outgoing is not None and self._owner.announce_parameters(iov, outgoing.writer_id):
                ct.memmove(iov, _two_words(outgoing.address, rtps.PARAMETERS_BYTES + size), 16)
        return result

    def _to_sample(self, sample: int, container: int, buffer: int | None, limit: int | None) -> Any:
        """Give the sample to a reader of this process."""
        outgoing = self._owner.outgoing.get(sample)
        if outgoing is None:
            return self._plain_to_sample(sample, container, buffer, limit)
        local = identified(memoryview(outgoing.packed)[rtps.PARAMETERS_BYTES :], outgoing.identity)
        copy = self._owner.allocate(len(local))
        ct.memmove(copy, local, len(local))
        ct.memmove(container, _two_words(copy, len(local)), 16)
        return True


class FastDds:
    """Who speaks to whom in the way of Fast DDS. One for the process; see the head."""

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
        self.layout = layout
        self._library = library
        self._samples: dict[tuple[int, bool], _Samples] = {}
        """By the address of Cyclone's table, and whether they are replies."""
        self._tables: dict[int, _Samples] = {}
        """By the address of our table."""
        self._lock = threading.Lock()
        """Held while the following changes; never during a call into Cyclone that takes a lock."""
        self._unread: set[int] = set()
        """Readers of participants that have something."""
        self._peers: set[tuple[int, bytes]] = set()
        """Participants on Fast DDS, each with the reader that told of it."""
        self.outgoing: dict[int, _Outgoing] = {}
        """Samples with an identity by their address. We hold a reference of each, so that no other gets its address."""
        self._to_forget: deque[int] = deque()
        """Their addresses, in the order in which they are looked at."""
        if self.refusal is None:
            self.new_sample = self._function("ddsi_serdata_from_ser_iov", *_FromSerIov)
            self.unref = self._function("ddsi_serdata_unref", *_Unref)
            self.allocate = self._function("dds_alloc", _Ptr, _Size)
            self._ref = self._function("ddsi_serdata_ref", _Ptr, _Ptr)
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

    def distrust(self, what: str) -> None:
        """Something is not as known: from now on nothing is replaced in samples, and services are refused."""
        self.refusal = f"Cyclone DDS does not behave as known: {what}"

    def prepare(self, type_object: int, dds_type: str) -> None:
        """Replace the functions of the type of a request or reply; other types are left alone."""
        is_reply = dds_type.endswith("_Response_")
        if self.refusal is not None or not (is_reply or dds_type.endswith("_Request_")):
            return
        place = _Ptr.from_address(type_object + self.layout.sertype_table)
        original = place.value
        assert original is not None
        with self._lock:
            samples = self._samples.get((original, is_reply))
            if samples is None:
                samples = self._samples[original, is_reply] = _Samples(self, original, is_reply=is_reply)
                self._tables[ct.addressof(samples.table)] = samples
                samples.look_into_received(True)  # until somebody has read who is there
        place.value = ct.addressof(samples.table)

    # -------------------------------------------------------------------------------------------- participants

    def notice(self, reader: int) -> None:
        """That reader of participants has something that nobody has looked at yet; maybe one of Fast DDS."""
        with self._lock:
            self._unread.add(reader)
            self._look_into_received(True)

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
                self._look_into_received(False)

    def forget(self, reader: int) -> None:
        """That reader is gone."""
        with self._lock:
            self._unread.discard(reader)
            self._peers = {peer for peer in self._peers if peer[0] != reader}
        self.sweep()

    def _look_into_received(self, look: bool) -> None:
        for samples in self._samples.values():
            samples.look_into_received(look)

    # -------------------------------------------------------------------------------------------------- sending

    def samples(self, type_object: int) -> _Samples | None:
        """The functions for samples of that type, if some of them are ours."""
        return self._tables.get(_Ptr.from_address(type_object + self.layout.sertype_table).value or 0)

    def write(self, entity: int, writer_guid: bytes, type_object: int, data: bytes, identity: Identity) -> int:
        """Send a sample with its identity; returns Cyclone's code, as `dds_write` does.

        Args:
            data: header and message; the length is a multiple of four.
        """
        packed = rtps.parameter_list(identity) + data
        address: int = _address_of(packed)
        iov = _two_words(address + rtps.PARAMETERS_BYTES, len(data))
        sample = self.new_sample(type_object, _SAMPLE_WITH_DATA, 1, iov, len(data))
        if not sample:
            return _BAD_PARAMETER
        samples = self._tables.get(_Ptr.from_address(sample).value or 0)
        if samples is None:
            self.unref(sample)
            self.distrust("a sample made for sending")
            return _BAD_PARAMETER
        if not samples.sends:
            samples.prepare_sending()
        self._ref(sample)
        self.outgoing[sample] = _Outgoing(packed, address, writer_guid[12:], identity)
        code: int = abi.undisturbed(self._write, entity, sample)
        self._to_forget.append(sample)
        self.sweep(_PATIENCE)
        return code

    def sweep(self, patience: int | None = None) -> None:
        """Forget samples that Cyclone has forgotten, because everybody has them or their writer is gone.

        Args:
            patience: after so many that have to be kept the others are not looked at; None looks at all.
        """
        with self._lock:
            for _ in range(len(self._to_forget)):
                sample = self._to_forget.popleft()
                if ct.c_uint32.from_address(sample + self.layout.references).value == 1:
                    del self.outgoing[sample]
                    self.unref(sample)
                    continue
                self._to_forget.append(sample)
                if patience is not None:
                    patience -= 1
                    if patience == 0:
                        return

    def announce_parameters(self, iov: int, writer_id: bytes) -> bool:
        """Set the flag in the packet that `iov` belongs to; False when that does not look like a packet of ours."""
        layout = self.layout
        out = _bytes_at(iov - layout.out_iov, layout.out.size)
        room, size, has_parameters, message, address = layout.out.unpack(out)
        if message or not rtps.DATA_FRAG_BYTES <= size <= room:
            return False  # no packet is being made: the sample is copied for somebody
        if has_parameters:
            return False  # Cyclone has put some in, for a reader that wants hashes of keys
        if address:
            data = _bytes_at(address, layout.out_head + size)
            if data[0] == rtps.INFO_SRC and data[24] == rtps.INFO_DST:
                for kind, length in ((rtps.DATA, rtps.DATA_BYTES), (rtps.DATA_FRAG, rtps.DATA_FRAG_BYTES)):
                    part = data[-length:]
                    if part[0] == kind and part[12:16] == writer_id:
                        flags = ct.c_ubyte.from_address(address + len(data) - length + 1)
                        flags.value |= rtps.HAS_PARAMETERS
                        return True
        self.distrust(f"a packet to send, {out.hex()}")
        return False
