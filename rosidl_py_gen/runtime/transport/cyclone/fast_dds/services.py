"""Services with Fast DDS peers: the identity of requests and replies, which Cyclone neither shows nor sends.

rmw_fastrtps puts bare messages on the wire and says in RTPS inline parameters whom they belong to. Cyclone reads and
writes no parameters of that kind. But its tables of functions for samples are data: here service topics get copies of
them with some functions replaced by ours.

- Receiving (`from_ser`): the parameters are read from the packet, and the sample becomes one with an identity, as
  `correlation.identified` makes it.
- Sending (`to_ser_ref`): called while Cyclone makes a packet, whether the first time or to repeat a lost one. The
  parameters go in front of the message, and a flag in the packet says so. Readers of this process need no packet: who
  takes the sample puts the identity in.

Rules, each with a test:

- Where something lies is known to `structures.py` alone. When a probe finds nothing, and after the first packet that
  does not look as expected, services of Fast DDS peers are refused; nothing is guessed.
- Replaced functions run in Cyclone's threads, under locks of Cyclone's. They take no lock, call nothing of Cyclone but
  what allocates and copies, log nothing, and never raise.
- They stand in the tables only while a Fast DDS participant may be there, because they add half to the time of a call.
  Cyclone tells of a new participant in its own thread before it takes anything else from it, and that puts them in
  (`notice`); whoever reads discovery takes them out again when it was none of Fast DDS (`settle`).
- They must not run when the interpreter is gone: contexts are closed at exit, which ends all threads of Cyclone.
- A small sample may not outlive its domain, whose pool it goes back to: `release` is called before that is deleted.

Source: docs/internals/dds.md 2 to 5; docs/internals/protocol.md 5.3.
"""

from __future__ import annotations

import ctypes as ct
import platform
import sys
import threading
from collections import deque
from typing import TYPE_CHECKING, Any, NamedTuple

from rosidl_py_gen.runtime.transport.cyclone import functions, structures, topics
from rosidl_py_gen.runtime.transport.cyclone.capabilities import UNBOUND, YES, Capabilities
from rosidl_py_gen.runtime.transport.cyclone.config import IGNORES_TYPES
from rosidl_py_gen.runtime.transport.cyclone.fast_dds import rtps
from rosidl_py_gen.runtime.transport.cyclone.functions import SAMPLE_WITH_DATA, address_of, pack_iov
from rosidl_py_gen.runtime.transport.cyclone.structures import SAMPLE_FUNCTIONS, TYPE_FUNCTIONS
from rosidl_py_gen.runtime.transport.dds.correlation import FAST_DDS_VENDOR, IDENTITY_BYTES, identified
from rosidl_py_gen.runtime.transport.discovered import Lost

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from rosidl_py_gen.runtime.transport.cyclone.functions import Api
    from rosidl_py_gen.runtime.transport.cyclone.topics import TypeObject
    from rosidl_py_gen.runtime.transport.dds.correlation import Identity
    from rosidl_py_gen.runtime.transport.discovered import DiscoveryEvent

_BAD_PARAMETER = -3
_DISCARDED = 1
"""What `from_ser` answers after 11.0.1 beside NULL, when it has made no sample."""
_PATIENCE = 4
"""See `FastDds.sweep`."""

_LOOKUP_REPLY = b"DDS::Builtin::TypeLookup_Reply"
_Ptr, _Size = ct.c_void_p, ct.c_size_t
_FromSer = (_Ptr, _Ptr, ct.c_int, _Ptr, _Size)
_ToSerRef = (_Ptr, _Ptr, _Size, _Size, _Ptr)
_make_nothing = ct.CFUNCTYPE(*_FromSer)(lambda *_: None)
_for_ever: dict[int, structures.Table] = {}
_ensure_thread_state = ct.PYFUNCTYPE(ct.c_int)(("PyGILState_Ensure", ct.pythonapi))


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
    type_object: int


class _Samples:
    """The functions for samples of requests, or of replies: a copy of Cyclone's table, with ours in it."""

    def __init__(self, owner: FastDds, type_object: TypeObject, slots: structures.Slots, *, is_reply: bool) -> None:
        self._owner = owner
        self._is_reply = is_reply
        self._slots = slots
        self.content = type_object.content or 0
        self.table = structures.copied_table(type_object.address, SAMPLE_FUNCTIONS)
        self._plain_receive = ct.PYFUNCTYPE(*_FromSer)(self.table[slots.from_ser] or 0)
        self._plain_to_ser_ref = ct.PYFUNCTYPE(*_ToSerRef)(self.table[slots.to_ser_ref] or 0)
        self._receive_function = ct.CFUNCTYPE(*_FromSer)(self._receive)
        self._to_ser_ref_function = ct.CFUNCTYPE(*_ToSerRef)(self._to_ser_ref)
        self._receivers = (self.table[slots.from_ser], ct.cast(self._receive_function, _Ptr).value)
        self.sends = False
        """Whether samples with an identity were written."""

    def look_into_received(self, look: bool) -> None:
        """Whether received samples are looked into."""
        self.table[self._slots.from_ser] = self._receivers[look]

    def prepare_sending(self) -> None:
        """To be called before a sample with an identity is written."""
        self.sends = True
        self.table[self._slots.to_ser_ref] = ct.cast(self._to_ser_ref_function, _Ptr).value

    def _receive(self, type_object: int, kind: int, fragment: int, size: int) -> Any:
        """Make a sample of received fragments."""
        owner = self._owner
        if not _thread.is_known:
            _thread.is_known = True
            _ensure_thread_state()
        try:
            before, packet, begin, payload, last = owner.packets.received(fragment)
            identity = rtps.read_submessage(before, before[begin:payload], is_reply=self._is_reply)
        except Exception as err:  # not to be raised into Cyclone
            owner.distrust(f"a received sample, {err!r}")
            identity = None
        if identity is None or kind != SAMPLE_WITH_DATA or size <= 4 or owner.refusal is not None:
            return self._plain_receive(type_object, kind, fragment, size)
        head = identified(before[payload:], identity)
        joined = None
        rest = packet + payload + 4
        if last < size:
            joined = self._plain_receive(type_object, kind, fragment, size)
            if joined in (None, _DISCARDED):
                return joined
            rest = joined + self.content + 4
        iov = pack_iov(address_of(head), len(head)) + pack_iov(rest, size - 4)
        sample = owner.api.serdata_from_ser_iov(type_object, kind, 2, iov, size + IDENTITY_BYTES)
        if joined is not None:
            owner.api.serdata_unref(joined)
        return sample

    def _to_ser_ref(self, sample: int, offset: int | None, size: int, iov: int) -> Any:
        """Say where the bytes for a packet lie: the first ones with the parameters in front."""
        result = self._plain_to_ser_ref(sample, offset or 0, size, iov)
        if not offset:
            outgoing = self._owner.outgoing.get(sample)
            if outgoing is not None and self._owner.announce_parameters(iov, outgoing.writer_id):
                structures.put_iov(iov, outgoing.address, rtps.PARAMETERS_BYTES + size)
        return result


class FastDds:
    """Who speaks to whom in the way of Fast DDS. One for the process; see the head."""

    def __init__(self, api: Api, lacks: Collection[str] = ()) -> None:
        """`lacks`: what a configuration may not say to this library."""
        self.api = api
        self.packets = structures.Packets()
        self.refusal: str | None = _untried()
        """Why services of Fast DDS peers cannot be used; None when they can."""
        self.reader_place: structures.ReaderPlace | None = None
        self.early_refusal = self.refusal or ""
        """Why their first samples are not asked for; empty when they are."""
        self.lookup_refusal = ""
        """Why they may not ask each other for types; empty when they may."""
        self._loopback = UNBOUND if IGNORES_TYPES in lacks else YES
        self._told: set[str] = set()
        self._slots: structures.Slots | None = None
        self._samples: dict[tuple[int, bool], _Samples] = {}
        """By the address of Cyclone's table, and whether they are replies."""
        self._tables: dict[int, _Samples] = {}
        """By the address of our table."""
        self._kept: dict[int, structures.Table] = {}
        """Tables of types, by the address of Cyclone's. For ever."""
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

    # ------------------------------------------------------------------------------------------- what can be done

    def capabilities(self) -> Capabilities:
        """What of all this works here, as far as it was tried."""
        return Capabilities(
            self.refusal or YES, self.early_refusal or YES, self.lookup_refusal or YES, loopback=self._loopback
        )

    def complaints(self) -> list[str]:
        """What to tell the user about Fast DDS peers, each once, when there are some."""
        new = [one for one in self.capabilities().complaints() if one not in self._told] if self._peers else []
        self._told.update(new)
        return new

    def distrust(self, what: str) -> None:
        """Something is not as known: from now on nothing is replaced in samples, and services are refused."""
        self.refusal = f"Cyclone DDS does not behave as known: {what}"

    def slots(self) -> structures.Slots | None:
        """Where the functions are; looked for once."""
        if self._slots is None:
            self._slots = structures.find_slots(self.api)
            if self._slots is None and self.refusal is None:
                self.refusal = "the functions for samples were not found in this library"
        return self._slots

    def drop_type_lookups(self, participant: int) -> None:
        """Let Cyclone drop what peers tell each other of their types, of which it dies in some versions.

        To be called when a domain was opened, before anybody answers.
        """
        slots, name = self.slots(), "rosidl_py_gen_neighbour"
        neighbour = topics.type_of(self.api, topics.create_opaque(self.api, participant, name, name), name)
        version = self.api.sertype_version
        found = neighbour and structures.find_type_of_domain(neighbour, _LOOKUP_REPLY, version)
        if slots is None or not found:
            self.lookup_refusal = "the type of their answers was not found in this library"
            return
        table = structures.copied_table(found, SAMPLE_FUNCTIONS)
        table[slots.from_ser] = ct.cast(_make_nothing, _Ptr).value
        structures.put_table(found, SAMPLE_FUNCTIONS, _for_ever.setdefault(found, table))

    def prepare(self, type_object: TypeObject, dds_type: str) -> None:
        """Replace the functions of the type of a request or reply; other types are left alone."""
        is_reply, address = dds_type.endswith("_Response_"), type_object.address
        if self.refusal is not None or not (is_reply or dds_type.endswith("_Request_")):
            return
        slots = self.slots()
        if slots is None:
            return
        original = structures.table_at(address, SAMPLE_FUNCTIONS)
        with self._lock:
            samples = self._samples.get((original, is_reply))
            if type_object.content is None or (samples is not None and samples.content != type_object.content):
                self.refusal = "the bytes of samples do not lie in one place"
                return
            if not structures.are_samples_as_known(self.api, address, slots):
                self.refusal = "samples do not look as known in this library"
                return
            if samples is None:
                samples = self._samples[original, is_reply] = _Samples(self, type_object, slots, is_reply=is_reply)
                self._tables[ct.addressof(samples.table)] = samples
                samples.look_into_received(True)  # until somebody has read who is there
            functions_of_type = structures.table_at(address, TYPE_FUNCTIONS)
            table = self._kept.get(functions_of_type)
            if table is None:
                table = self._kept[functions_of_type] = structures.copied_table(address, TYPE_FUNCTIONS)
                # Endpoints would get a type of their own, with the original functions for samples.
                table[slots.derive_sertype] = None
        structures.put_table(address, TYPE_FUNCTIONS, table)
        structures.put_table(address, SAMPLE_FUNCTIONS, samples.table)

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
        return self._tables.get(structures.table_at(type_object, SAMPLE_FUNCTIONS))

    def write(self, entity: int, writer_guid: bytes, type_object: int, data: bytes, identity: Identity) -> int:
        """Send a sample with its identity; returns Cyclone's code.

        Args:
            data: header and message; the length is a multiple of four.
        """
        packed = rtps.parameter_list(identity) + data
        address: int = address_of(packed)
        iov = pack_iov(address + rtps.PARAMETERS_BYTES, len(data))
        sample = self.api.serdata_from_ser_iov(type_object, SAMPLE_WITH_DATA, 1, iov, len(data))
        samples = self.samples(type_object)
        if not sample or samples is None:
            if sample:
                self.api.serdata_unref(sample)
            return _BAD_PARAMETER
        if not samples.sends:
            samples.prepare_sending()
        self.api.serdata_ref(sample)
        self.outgoing[sample] = _Outgoing(packed, address, writer_guid[12:], identity, type_object)
        self._to_forget.append(sample)  # whatever interrupts the write
        code: int = functions.undisturbed(self.api.writecdr, entity, sample)
        if code in functions.NOT_TAKEN:
            self.api.serdata_unref(sample)
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
                assert self._slots is not None
                if structures.references(sample, self._slots) == 1:
                    del self.outgoing[sample]
                    self.api.serdata_unref(sample)
                    continue
                self._to_forget.append(sample)
                if patience is not None:
                    patience -= 1
                    if patience == 0:
                        return

    def release(self, type_objects: Collection[int]) -> None:
        """Forget all samples of these types, whose domain is about to be deleted."""
        with self._lock:
            for sample in [one for one in self._to_forget if self.outgoing[one].type_object in type_objects]:
                self._to_forget.remove(sample)
                del self.outgoing[sample]
                self.api.serdata_unref(sample)

    def local_content(self, sample: int) -> bytes | None:
        """The bytes of a sample with an identity for a reader of this process; None when it has none."""
        outgoing = self.outgoing.get(sample)
        if outgoing is None:
            return None
        return identified(memoryview(outgoing.packed)[rtps.PARAMETERS_BYTES :], outgoing.identity)

    def announce_parameters(self, iov: int, writer_id: bytes) -> bool:
        """Set the flag in the packet that `iov` belongs to; False when that does not look like a packet of ours."""
        try:
            return self.packets.announce_parameters(iov, writer_id)
        except Exception as err:  # not to be raised into Cyclone
            self.distrust(f"a packet to send, {err}")
            return False


def _untried() -> str | None:
    """Why nothing is looked for on this machine."""
    system, bits = platform.system(), 8 * structures.WORD
    if (system, bits, sys.byteorder) == ("Linux", 64, "little"):
        return None
    return f"that was never tried on {system} with {bits} bits, {sys.byteorder}-endian"
