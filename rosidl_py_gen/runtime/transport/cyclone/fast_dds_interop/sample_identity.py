"""Services with Fast DDS peers: the identity of requests and replies, which Cyclone neither shows nor sends.

rmw_fastrtps puts bare messages on the wire and says in RTPS inline parameters whom they belong to. Cyclone reads and
writes no parameters of that kind. But its tables of functions for samples are data: here service topics get copies of
them with some functions replaced by ours.

- Receiving (`from_ser`): the parameters are read from the packet, and the sample becomes one with an identity, as
  `correlation.identified` makes it.
- Sending (`to_ser_ref`): called while Cyclone makes a packet, whether the first time or to repeat a lost one. The
  sample has the parameters in front of the message, where Cyclone does not look; they go into the packet, and a flag
  says so. Readers of this process need no packet: who takes the sample puts the identity in.

Rules, each with a test:

- Where something lies is known to `structures.py` alone. When a probe finds nothing, and after the first packet that
  does not look as expected, services of Fast DDS peers are refused; nothing is guessed.
- Replaced functions run in Cyclone's threads, under locks of Cyclone's. They take no lock, call nothing of Cyclone but
  what allocates and copies, log nothing, and never raise.
- They stand in the tables only while a Fast DDS participant may be there, because they add half to the time of a call.
  Cyclone tells of a new participant in its own thread before it takes anything else from it, and that puts them in
  (`on_participants_pending`); whoever reads discovery takes them out again when it was none of Fast DDS (`end_read`).
- They must not run when the interpreter is gone: contexts are closed at exit, which ends all threads of Cyclone.

Source: docs/internals/dds.md 2 to 5; docs/internals/protocol.md 5.3.
"""

from __future__ import annotations

import ctypes as ct
import os
import platform
import sys
import threading
from functools import cached_property
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.runtime.transport.cyclone import c_api, private_layout
from rosidl_py_gen.runtime.transport.cyclone.c_api import SAMPLE_WITH_DATA, address_of, pack_iov
from rosidl_py_gen.runtime.transport.cyclone.config import IGNORE_TYPE_INFORMATION
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop import rtps
from rosidl_py_gen.runtime.transport.cyclone.private_layout import SAMPLE_FUNCTIONS, TYPE_FUNCTIONS, bytes_at
from rosidl_py_gen.runtime.transport.dds.correlation import FAST_DDS_VENDOR, IDENTITY_BYTES, embed_identity
from rosidl_py_gen.runtime.transport.discovery_events import EntityLost

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from rosidl_py_gen.runtime.transport.cyclone.c_api import CycloneApi
    from rosidl_py_gen.runtime.transport.cyclone.topics import Sertype
    from rosidl_py_gen.runtime.transport.dds.correlation import SampleIdentity
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveryEvent

_BAD_PARAMETER = -3
_DISCARDED = 1
"""What `from_ser` answers after 11.0.1 beside NULL, when it has made no sample."""
_IDENTITY_MAGIC = b"\0\1" + os.urandom(6)
"""Begins samples with an identity that are to be sent; what comes from the network cannot begin so."""
_BEFORE_PARAMETERS = len(_IDENTITY_MAGIC) + 4
_PREFIX_BYTES = _BEFORE_PARAMETERS + rtps.PARAMETERS_BYTES
"""The mark, the id of the writer, the parameters; the message follows."""

_UNBOUND = "Cyclone DDS before 11 finds no nodes on Fast DDS then; data may leave by the address that a peer announces"
_CAPABILITIES = (
    ("refusal", "services of nodes on Fast DDS", "services of Fast DDS nodes cannot be used here, topics can"),
    (
        "early_refusal",
        "first samples of nodes on Fast DDS",
        "what Fast DDS nodes send in their first second may be lost here",
    ),
    (
        "lookup_refusal",
        "nodes on Fast DDS that ask each other for types",
        "Fast DDS nodes that ask each other for types, as those of Kilted do, may end this process",
    ),
    ("loopback_refusal", "localhost mode on the loopback interface alone", ""),
)
"""What not every libddsc can do for us: where it stands why not, what it is called in `Context.capabilities` and by the
doctor, and what the log says once nodes on Fast DDS are there."""
_LOOKUP_REPLY = b"DDS::Builtin::TypeLookup_Reply"
PROBE_TYPE = "rosidl_py_gen_neighbour"
"""The name of a type that every domain has where `TypeLookup_Reply` has to be found beside one."""
_Ptr, _Size = ct.c_void_p, ct.c_size_t
_FromSer = (_Ptr, _Ptr, ct.c_int, _Ptr, _Size)
_ToSerRef = (_Ptr, _Ptr, _Size, _Size, _Ptr)
_make_nothing = ct.CFUNCTYPE(*_FromSer)(lambda *_: None)
_ensure_thread_state = ct.PYFUNCTYPE(ct.c_int)(("PyGILState_Ensure", ct.pythonapi))


_thread = threading.local()
"""Of Cyclone's, in which a sample was looked into: `is_known`.

Python makes its state of a foreign thread anew for each call, which takes longer than the call (a service call from
rclpy: 363 us, with the state kept 294). One more reference keeps it; what it takes stays until the process ends.
"""


class _SampleHooks:
    """The functions for samples of requests, or of replies: a copy of Cyclone's table, with ours in it."""

    def __init__(
        self,
        owner: FastDdsInterop,
        type_object: Sertype,
        slots: private_layout.VtableSlots,
        size_place: int,
        *,
        is_reply: bool,
    ) -> None:
        self._owner = owner
        self._is_reply = is_reply
        self._slots = slots
        self._size_place = size_place
        self.content = type_object.content or 0
        self.table = private_layout.copy_vtable(type_object.address, SAMPLE_FUNCTIONS)
        self._plain_receive = ct.PYFUNCTYPE(*_FromSer)(self.table[slots.from_ser] or 0)
        self._plain_to_ser_ref = ct.PYFUNCTYPE(*_ToSerRef)(self.table[slots.to_ser_ref] or 0)
        self._receive_function = ct.CFUNCTYPE(*_FromSer)(self._receive)
        self._to_ser_ref_function = ct.CFUNCTYPE(*_ToSerRef)(self._to_ser_ref)
        self._receivers = (self.table[slots.from_ser], ct.cast(self._receive_function, _Ptr).value)
        self.sends = False
        """Whether samples with an identity were written."""

    def enable_receive_hook(self, look: bool) -> None:
        """Whether received samples are looked into."""
        self.table[self._slots.from_ser] = self._receivers[look]

    def write(self, entity: int, writer_id: bytes, type_object: int, data: bytes, identity: SampleIdentity) -> int:
        """Send a sample that has its identity in front, where Cyclone does not look; returns Cyclone's code.

        Args:
            data: header and message; the length is a multiple of four.
        """
        api, code = self._owner.api, _BAD_PARAMETER
        sample = private_layout.new_sample(
            api, type_object, _IDENTITY_MAGIC + writer_id + rtps.encode_inline_qos(identity) + data
        )
        if not sample:
            return code
        if private_layout.hide_sample_tail(api, sample, self._size_place, _PREFIX_BYTES):
            self.sends = True
            self.table[self._slots.to_ser_ref] = ct.cast(self._to_ser_ref_function, _Ptr).value
            code = c_api.call_with_sigint_deferred(api.writecdr, entity, sample)
        else:
            self._owner.disable("the size of a sample")
        if code in c_api.SAMPLE_NOT_CONSUMED:
            api.serdata_unref(sample)
        return code

    def write_plain(self, entity: int, sample: ct.c_void_p) -> int:
        """Send a sample without an identity, which our functions see, too, once there were others."""
        write = self._owner.api.bare_write
        return c_api.call_with_sigint_deferred(write, entity, sample) if self.sends else write(entity, sample)

    def identified(self, sample: int, size: int) -> bytes | None:
        """A sample of this process with its identity, as a received one; None when it has none.

        Args:
            size: what Cyclone takes for it.
        """
        if size < len(_IDENTITY_MAGIC) or bytes_at(sample + self.content, len(_IDENTITY_MAGIC)) != _IDENTITY_MAGIC:
            return None
        data = bytes_at(sample + self.content, _PREFIX_BYTES + size)
        return embed_identity(data[_PREFIX_BYTES:], rtps.decode_inline_qos(data[_BEFORE_PARAMETERS:_PREFIX_BYTES]))

    def _receive(self, type_object: int, kind: int, fragment: int, size: int) -> Any:
        """Make a sample of received fragments."""
        owner = self._owner
        if not hasattr(_thread, "is_known"):
            _thread.is_known = True
            _ensure_thread_state()
        plain = self._plain_receive(type_object, kind, fragment, size)
        if plain in (None, _DISCARDED) or kind != SAMPLE_WITH_DATA or owner.refusal is not None:
            return plain
        try:
            identity = rtps.read_submessage(*owner.packets.read_received(fragment), is_reply=self._is_reply)
        except Exception as err:  # not to be raised into Cyclone
            owner.disable(f"a received sample, {err!r}")
            identity = None
        if identity is None:
            return plain
        begin = plain + self.content
        head = embed_identity(bytes_at(begin, 4), identity)
        iov = pack_iov(address_of(head), len(head)) + pack_iov(begin + 4, size - 4)
        sample = owner.api.serdata_from_ser_iov(type_object, kind, 2, iov, size + IDENTITY_BYTES)
        owner.api.serdata_unref(plain)
        return sample

    def _to_ser_ref(self, sample: int, offset: int | None, size: int, iov: int) -> Any:
        """Say where the bytes for a packet lie: the first ones with the parameters in front."""
        result = self._plain_to_ser_ref(sample, offset or 0, size, iov)
        begin = sample + self.content
        if bytes_at(begin, len(_IDENTITY_MAGIC)) == _IDENTITY_MAGIC:
            message = begin + _PREFIX_BYTES + (offset or 0)
            if not offset and self._owner.set_inline_qos_flag(iov, bytes_at(begin + len(_IDENTITY_MAGIC), 4)):
                message, size = message - rtps.PARAMETERS_BYTES, rtps.PARAMETERS_BYTES + size
            private_layout.write_iovec(iov, message, size)
        return result


class FastDdsInterop:
    """Who speaks to whom in the way of Fast DDS. One for the process; see the head."""

    def __init__(self, api: CycloneApi, lacks: Collection[str] = ()) -> None:
        """`lacks`: what a configuration may not say to this library."""
        self.api = api
        self.packets = private_layout.PacketAccess()
        self.refusal: str | None = _untried()
        """Why services of Fast DDS peers cannot be used; None when they can."""
        self.reader_place: private_layout.ReaderOffsets | None = None
        self.early_refusal = self.refusal or ""
        """Why their first samples are not asked for; empty when they are."""
        self.lookup_refusal = ""
        """Why they may not ask each other for types; empty when they may."""
        self.loopback_refusal = _UNBOUND if IGNORE_TYPE_INFORMATION in lacks else ""
        """Why localhost mode uses other network interfaces; empty when it does not."""
        self._warned: set[str] = set()
        self._samples: dict[tuple[int, bool], _SampleHooks] = {}
        """By the address of Cyclone's table, and whether they are replies."""
        self._tables: dict[int, _SampleHooks] = {}
        """By the address of our table."""
        self._lock = threading.Lock()
        """Held while the following changes; never during a call into Cyclone that takes a lock."""
        self._unread: set[int] = set()
        """Readers of participants that have something."""
        self._peers: set[tuple[int, bytes]] = set()
        """Participants on Fast DDS, each with the reader that told of it."""

    # ------------------------------------------------------------------------------------------- what can be done

    def capabilities(self) -> dict[str, str]:
        """What of all this works here, as far as it was tried: each ``"yes"`` or why not."""
        return {name: getattr(self, reason) or "yes" for reason, name, _ in _CAPABILITIES}

    def new_warnings(self) -> list[str]:
        """What to tell the user about Fast DDS peers, each once, when there are some."""
        told = [f"{what}: {why}" for reason, _, what in _CAPABILITIES if what and (why := getattr(self, reason))]
        new = [one for one in told if one not in self._warned] if self._peers else []
        self._warned.update(new)
        return new

    def disable(self, what: str) -> None:
        """Something is not as known: from now on nothing is replaced in samples, and services are refused."""
        self.refusal = f"Cyclone DDS does not behave as known: {what}"

    @cached_property
    def slots(self) -> private_layout.VtableSlots | None:
        """Where the functions are; looked for once."""
        found = private_layout.probe_vtable_slots(self.api)
        if found is None and self.refusal is None:
            self.refusal = "the functions for samples were not found in this library"
        return found

    def _drop_type_lookups(self, neighbour: int) -> None:
        """Let Cyclone drop what peers tell each other of their types, of which it dies in some versions."""
        slots = self.slots
        found = private_layout.find_type_of_domain(neighbour, _LOOKUP_REPLY, self.api.sertype_version)
        if slots is None or not found:
            self.lookup_refusal = "the type of their answers was not found in this library"
            return
        private_layout.replace_vtable_function(
            found, SAMPLE_FUNCTIONS, slots.from_ser, ct.cast(_make_nothing, _Ptr).value
        )

    def prepare(self, type_object: Sertype, dds_type: str) -> None:
        """Replace the functions of the type of a request or reply; other types are left alone."""
        is_reply, address = dds_type.endswith("_Response_"), type_object.address
        if dds_type == PROBE_TYPE:
            self._drop_type_lookups(address)
        if self.refusal is not None or not (is_reply or dds_type.endswith("_Request_")):
            return
        slots = self.slots
        if slots is None:
            return
        original = private_layout.vtable_address(address, SAMPLE_FUNCTIONS)
        with self._lock:
            samples = self._samples.get((original, is_reply))
            if type_object.content is None or (samples is not None and samples.content != type_object.content):
                self.refusal = "the bytes of samples do not lie in one place"
                return
            if samples is None:
                size_place = private_layout.probe_size_offset(self.api, address, type_object.content)
                if size_place is None:
                    self.refusal = "samples do not look as known in this library"
                    return
                samples = _SampleHooks(self, type_object, slots, size_place, is_reply=is_reply)
                self._samples[original, is_reply] = samples
                self._tables[ct.addressof(samples.table)] = samples
                samples.enable_receive_hook(True)  # until somebody has read who is there
        # Endpoints would get a type of their own, with the original functions for samples.
        private_layout.replace_vtable_function(address, TYPE_FUNCTIONS, slots.derive_sertype, None)
        private_layout.set_vtable(address, SAMPLE_FUNCTIONS, samples.table)

    # -------------------------------------------------------------------------------------------- participants

    def on_participants_pending(self, reader: int) -> None:
        """That reader of participants has something that nobody has looked at yet; maybe one of Fast DDS."""
        with self._lock:
            self._unread.add(reader)
            self._look_into_received(True)

    def begin_read(self, reader: int) -> None:
        """Somebody is going to take all that reader has, and to call `end_read` then."""
        with self._lock:
            self._unread.discard(reader)

    def end_read(self, reader: int, events: Iterable[DiscoveryEvent]) -> None:
        """Take in what that reader had."""
        with self._lock:
            for event in events:
                if isinstance(event, EntityLost):
                    self._peers.discard((reader, event.guid))
                elif event.guid.startswith(FAST_DDS_VENDOR):
                    self._peers.add((reader, event.guid))
            if not self._peers and not self._unread:
                self._look_into_received(False)

    def forget_reader(self, reader: int) -> None:
        """That reader is gone."""
        with self._lock:
            self._unread.discard(reader)
            self._peers = {peer for peer in self._peers if peer[0] != reader}

    def _look_into_received(self, look: bool) -> None:
        for samples in self._samples.values():
            samples.enable_receive_hook(look)

    # -------------------------------------------------------------------------------------------------- sending

    def samples(self, type_object: int) -> _SampleHooks | None:
        """The functions for samples of that type, if some of them are ours."""
        return self._tables.get(private_layout.vtable_address(type_object, SAMPLE_FUNCTIONS))

    def set_inline_qos_flag(self, iov: int, writer_id: bytes) -> bool:
        """Set the flag in the packet that `iov` belongs to; False when that does not look like a packet of ours."""
        try:
            return self.packets.set_inline_qos_flag(iov, writer_id)
        except Exception as err:  # not to be raised into Cyclone
            self.disable(f"a packet to send, {err}")
            return False


def _untried() -> str | None:
    """Why nothing is looked for on this machine."""
    system, bits = platform.system(), 8 * private_layout.WORD
    if (system, bits, sys.byteorder) == ("Linux", 64, "little"):
        return None
    return f"that was never tried on {system} with {bits} bits, {sys.byteorder}-endian"
