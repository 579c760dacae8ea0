"""Sample identities in requests and replies of Fast DDS peers, which Cyclone neither reads nor writes.

rmw_fastrtps sends bare messages, with the DDS-RPC sample identity as RTPS inline QoS. The types of services get a copy
of Cyclone's function table for samples, with two hooks (docs/internals/dds.md 3 and 4): `from_ser` receives a sample,
`to_ser_ref` sends one. Bytes of packets come from the network: any content is possible.

Thread rules: hooks run in Cyclone's threads, with locks of Cyclone held. They take no lock, call only functions of
Cyclone that allocate and copy, do not log and never raise.

`FastDdsSupport` has the results of probes of the loaded library, which hold for the whole process, and the reasons why
something is missing. `FastDdsInterop` has the types of one domain. Peers are state of a participant (`peers.py`).

Source: docs/internals/protocol.md 5.3, docs/internals/dds.md 3 to 5; OMG DDSI-RTPS 2.3, 9.4 and 9.6.
"""

from __future__ import annotations

import ctypes as ct
import os
import platform
import struct
import sys
import threading
from collections import defaultdict
from functools import cached_property
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.runtime.transport.cyclone import library, private_layout
from rosidl_py_gen.runtime.transport.cyclone.library import (
    IGNORE_TYPE_INFORMATION,
    SAMPLE_WITH_DATA,
    address_of,
    pack_iov,
)
from rosidl_py_gen.runtime.transport.cyclone.private_layout import (
    DATA,
    DATA_BYTES,
    DATA_FRAG,
    INLINE_QOS_FLAG,
    SAMPLE_FUNCTIONS,
    TYPE_FUNCTIONS,
    bytes_at,
)
from rosidl_py_gen.runtime.transport.dds.services import IDENTITY_BYTES, SampleIdentity, embed_identity
from rosidl_py_gen.runtime.transport.middleware_threads import retain_thread_state

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from rosidl_py_gen.runtime.transport.cyclone.domain import Sertype
    from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.peers import FastDdsPeers
    from rosidl_py_gen.runtime.transport.cyclone.library import CycloneApi

FAST_DDS_VENDOR = b"\x01\x0f"
"""RTPS vendor id of Fast DDS, with which its GUIDs begin."""
INLINE_QOS_BYTES = 2 * (4 + IDENTITY_BYTES) + 4
"""Length in bytes of the inline QoS that `encode_inline_qos` returns."""

_LITTLE = 1
_PID_END = 1
_PID_IDENTITY = 0x0083
_PID_LEGACY_IDENTITY = 0x800F
"""Parameter id with which Fast DDS up to 2.9 sends a sample identity; later versions send this and the standard
parameter."""
_LEGACY_VENDORS = (FAST_DDS_VENDOR, b"\x01\x01")
"""RTPS vendor ids of Fast DDS and RTI; only for them parameters above 0x8000 have the meaning that Fast DDS gives them.
"""
_both = struct.Struct("<HH16siI HH16siI I")
_numbers = (struct.Struct(">HH").unpack_from, struct.Struct("<HH").unpack_from)
_sequence_numbers = (struct.Struct(">iI").unpack_from, struct.Struct("<iI").unpack_from)


def encode_inline_qos(identity: SampleIdentity) -> bytes:
    """Encode a sample identity as inline QoS: the two parameters for it and the end of the list, little-endian."""
    guid, sequence = identity
    high, low = sequence >> 32, sequence & 0xFFFFFFFF
    return _both.pack(
        *(_PID_IDENTITY, IDENTITY_BYTES, guid, high, low),
        *(_PID_LEGACY_IDENTITY, IDENTITY_BYTES, guid, high, low),
        _PID_END,
    )


def read_submessage(packet: bytes, submessage: bytes, *, is_reply: bool) -> SampleIdentity | None:
    """Return the sample identity of a received request or reply.

    `packet` begins with the RTPS header. `submessage` is DATA or DATA_FRAG up to the payload, as Cyclone stores it: the
    numbers of the header and the writer id in the byte order of this machine (little-endian).

    Returns:
        GUID and sequence number; None for a sample of another middleware, and for a reply to a request without
        identity.

    Raises:
        ValueError: the bytes are not an RTPS packet with a DATA or DATA_FRAG submessage.
    """
    if packet[:4] != b"RTPS" or not submessage or submessage[0] not in (DATA, DATA_FRAG):
        raise ValueError(f"no RTPS data: {packet.hex()} {submessage[:DATA_BYTES].hex()}")
    if len(submessage) < DATA_BYTES:
        return None  # the payload of this peer begins inside the header
    flags, vendor = submessage[1], packet[6:8]
    identity = None
    if flags & INLINE_QOS_FLAG:
        after_header = 8 + int.from_bytes(submessage[6:8], "little")
        identity = _find_identity(submessage, after_header, flags & _LITTLE, vendor in _LEGACY_VENDORS)
    if is_reply:
        return identity
    high, low = _sequence_numbers[_LITTLE](submessage, 16)
    if identity is not None and any(identity[0]):
        return identity[0], high << 32 | low
    if vendor != FAST_DDS_VENDOR:
        return None
    return packet[8:20] + submessage[15:11:-1], high << 32 | low


def _find_identity(submessage: bytes, offset: int, order: int, knows_legacy: bool) -> SampleIdentity | None:
    unpack = _numbers[order]
    while offset + 4 <= len(submessage):
        pid, length = unpack(submessage, offset)
        offset += 4
        if pid == _PID_END:
            break
        is_identity = pid == _PID_IDENTITY or (pid == _PID_LEGACY_IDENTITY and knows_legacy)
        if is_identity and length >= IDENTITY_BYTES and offset + length <= len(submessage):
            high, low = _sequence_numbers[order](submessage, offset + 16)
            return submessage[offset : offset + 16], high << 32 | low
        offset += length
    return None


_BAD_PARAMETER = -3
_DISCARDED = 1
"""Result of `from_ser` in Cyclone after 11.0.1 that, like NULL, means that no sample was created."""
_IDENTITY_MAGIC = b"\0\1" + os.urandom(6)
"""First bytes of the prefix that marks a sample with embedded identity. They are random, so received data cannot
imitate them."""
_INLINE_QOS_OFFSET = len(_IDENTITY_MAGIC) + 4
_PREFIX_BYTES = _INLINE_QOS_OFFSET + INLINE_QOS_BYTES
"""Length of the prefix that is embedded in a sample with identity: magic bytes, writer id, inline QoS."""

_Ptr, _Size = ct.c_void_p, ct.c_size_t
_FromSer = (_Ptr, _Ptr, ct.c_int, _Ptr, _Size)
_ToSerRef = (_Ptr, _Ptr, _Size, _Size, _Ptr)
create_no_sample = ct.CFUNCTYPE(*_FromSer)(lambda *_: None)
"""C function that replaces Cyclone's `from_ser` and drops all received samples."""


class SampleIdentities:
    """Sample identities of requests, or of replies, in one domain.

    An object has a copy of Cyclone's vtable for samples, with the two hooks (docs/internals/cyclone_memory.md 4).
    """

    def __init__(
        self,
        owner: FastDdsSupport,
        type_object: Sertype,
        slots: private_layout.VtableSlots,
        size_offset: int,
        *,
        is_reply: bool,
    ) -> None:
        self._owner = owner
        self._is_reply = is_reply
        self.is_lent = False
        """True while a domain uses the hooks. Lock: the lock of `FastDdsSupport` must be held to lend them."""
        self._slots = slots
        self._size_offset = size_offset
        self.payload_offset = type_object.payload_offset or 0
        self.table = private_layout.copy_vtable(type_object.address, SAMPLE_FUNCTIONS)
        self._plain_from_ser = ct.PYFUNCTYPE(*_FromSer)(self.table[slots.from_ser] or 0)
        self.plain_to_ser_ref = ct.PYFUNCTYPE(*_ToSerRef)(self.table[slots.to_ser_ref] or 0)
        """Original `to_ser_ref` of Cyclone, which the send hook calls."""
        self._from_ser_hook = ct.CFUNCTYPE(*_FromSer)(self._from_ser)
        self._to_ser_ref_hook = ct.CFUNCTYPE(*_ToSerRef)(self._to_ser_ref)
        self._from_ser_functions = (self.table[slots.from_ser], ct.cast(self._from_ser_hook, _Ptr).value)
        self.sends = False
        """True once a sample with an identity has been written, so that the send hook is needed."""

    def enable_receive_hook(self, is_enabled: bool) -> None:
        """Make Cyclone call the receive hook for each received sample.

        With False, make it call its own function again.
        """
        # The hook adds half to the time of a service call, so it is active only while a Fast DDS participant may exist.
        self.table[self._slots.from_ser] = self._from_ser_functions[is_enabled]

    def write(self, entity: int, writer_id: bytes, type_object: int, data: bytes, identity: SampleIdentity) -> int:
        """Send a sample, whose length is a multiple of 4, with an identity; return Cyclone's return code."""
        api, code = self._owner.api, _BAD_PARAMETER
        # The sample begins with a hidden prefix. Its size field is then reduced by the prefix, so that Cyclone counts,
        # fragments and frees a sample that has the size of the message (docs/internals/cyclone_memory.md 5).
        sample = private_layout.new_sample(
            api, type_object, _IDENTITY_MAGIC + writer_id + encode_inline_qos(identity) + data
        )
        if not sample:
            return code
        if private_layout.hide_sample_tail(api, sample, self._size_offset, _PREFIX_BYTES):
            self.sends = True
            self.table[self._slots.to_ser_ref] = ct.cast(self._to_ser_ref_hook, _Ptr).value
            code = library.call_with_sigint_deferred(api.writecdr, entity, sample)
        else:
            self._owner.disable("the size of a sample")
        if code in library.SAMPLE_NOT_CONSUMED:
            api.serdata_unref(sample)
        return code

    def write_plain(self, entity: int, sample: ct.c_void_p) -> int:
        """Send a sample without identity; return Cyclone's return code."""
        write = self._owner.api.bare_write
        # Once a sample with an identity was sent, Cyclone calls the send hook for all samples.
        return library.call_with_sigint_deferred(write, entity, sample) if self.sends else write(entity, sample)

    def with_embedded_identity(self, sample: int, size: int) -> bytes | None:
        """Return the payload of a sample that this process wrote, with the sample's identity embedded.

        Returns:
            None if the sample has no identity, or was received from another process.
        """
        # Inside of a process a reader gets the sample that was written, with its hidden prefix, and no packet.
        if (
            size < len(_IDENTITY_MAGIC)
            or bytes_at(sample + self.payload_offset, len(_IDENTITY_MAGIC)) != _IDENTITY_MAGIC
        ):
            return None
        data = bytes_at(sample + self.payload_offset, _PREFIX_BYTES + size)
        _, _, guid, high, low, *_ = _both.unpack(data[_INLINE_QOS_OFFSET:_PREFIX_BYTES])
        return embed_identity(data[_PREFIX_BYTES:], (guid, high << 32 | low))

    def _from_ser(self, type_object: int, kind: int, fragment: int, size: int) -> Any:
        """Create a sample from received fragments, with the sample identity embedded if there is one.

        Called by Cyclone; must not raise, block or log.
        """
        owner = self._owner
        retain_thread_state()
        plain = self._plain_from_ser(type_object, kind, fragment, size)
        if plain in (None, _DISCARDED) or kind != SAMPLE_WITH_DATA or owner.refusal is not None:
            return plain
        try:
            identity = read_submessage(*owner.packets.read_received(fragment), is_reply=self._is_reply)
        except Exception as err:  # must not reach Cyclone
            owner.disable(f"a received sample, {err!r}")
            identity = None
        if identity is None:
            return plain
        # Cyclone ignores the inline QoS and discards it after delivery. So a second sample contains the identity after
        # the first four bytes, and replaces the first sample.
        begin = plain + self.payload_offset
        head = embed_identity(bytes_at(begin, 4), identity)
        iov = pack_iov(address_of(head), len(head)) + pack_iov(begin + 4, size - 4)
        sample = owner.api.serdata_from_ser_iov(type_object, kind, 2, iov, size + IDENTITY_BYTES)
        owner.api.serdata_unref(plain)
        return sample

    def _to_ser_ref(self, sample: int, offset: int | None, size: int, iov: int) -> Any:
        """Set the iovec of a fragment of a sample that Cyclone sends, and add inline QoS to the first fragment.

        Called by Cyclone; must not raise.
        """
        result = self.plain_to_ser_ref(sample, offset or 0, size, iov)
        begin = sample + self.payload_offset
        if bytes_at(begin, len(_IDENTITY_MAGIC)) == _IDENTITY_MAGIC:
            # Called for each fragment, also for a retransmission. Only the first has the inline QoS, at the end of the
            # header in the packet; all fragments are shifted past the hidden prefix.
            if not offset:
                prefix = bytes_at(begin + len(_IDENTITY_MAGIC), 4 + INLINE_QOS_BYTES)
                self._owner.append_inline_qos(iov, prefix[:4], prefix[4:])
            private_layout.write_iovec(iov, begin + _PREFIX_BYTES + (offset or 0), size)
        return result


# ----------------------------------------------------------------------------------------------- support by the library

_UNBOUND = "with it, Cyclone DDS before 11 finds no nodes on Fast DDS; data may go to any address that peers announce"
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
        "Fast DDS nodes that ask each other for types, as nodes of Kilted do, may end this process",
    ),
    ("loopback_refusal", "localhost mode on the loopback interface alone", ""),
)
"""Capabilities that not every libddsc has: attribute with the reason why it is missing, name in `Context.capabilities`
and `rosidl-py doctor`, and warning that is logged when a Fast DDS node is discovered."""


class FastDdsSupport:
    """Support for Fast DDS peers by the loaded library; one object for the process."""

    def __init__(self, api: CycloneApi, unsupported: Collection[str] = ()) -> None:
        self.api = api
        self.packets = private_layout.PacketAccess()
        self.refusal: str | None = _untested_platform()
        """Reason why services of Fast DDS peers cannot be used; None if they can be used."""
        self.reader_offsets: private_layout.ReaderOffsets | None = None
        self.early_refusal = self.refusal or ""
        """Reason why early samples of Fast DDS peers are not requested; empty if they are requested."""
        self.crashes_on_type_lookups = IGNORE_TYPE_INFORMATION in unsupported
        """True if replies of type lookups between Fast DDS peers end the process, unless they are dropped."""
        self.lookup_refusal = ""
        """Reason why type lookups between Fast DDS peers are not dropped; empty if they are, or need not be."""
        self.loopback_refusal = _UNBOUND if IGNORE_TYPE_INFORMATION in unsupported else ""
        """Reason why localhost mode uses other interfaces than loopback; empty if it uses loopback alone."""
        self._warned: set[str] = set()
        self._hooks: defaultdict[tuple[int, bool], list[SampleIdentities]] = defaultdict(list)
        """Sample hooks by the address of Cyclone's original vtable, and True for replies. They are never freed, because
        samples that outlive their domain refer to the vtable (docs/internals/cyclone_memory.md 4)."""
        self._lock = threading.Lock()

    def capabilities(self) -> dict[str, str]:
        """Return each capability with ``"yes"``, or the reason why it is missing."""
        _ = self.slots  # probes whether services are available
        return {name: getattr(self, reason) or "yes" for reason, name, _ in _CAPABILITIES}

    def new_warnings(self) -> list[str]:
        """Return warnings about missing capabilities that were not returned before. Called with Fast DDS peers only."""
        reasons = [(warning, getattr(self, reason)) for reason, _, warning in _CAPABILITIES if warning]
        warnings = [f"{warning}: {reason}" for warning, reason in reasons if reason]
        new = [warning for warning in warnings if warning not in self._warned]
        self._warned.update(new)
        return new

    def disable(self, unexpected: str) -> None:
        """Refuse services of Fast DDS peers from now on, because of unexpected data in Cyclone."""
        self.refusal = f"unexpected data in Cyclone DDS: {unexpected}"

    @cached_property
    def slots(self) -> private_layout.VtableSlots | None:
        """Slots in Cyclone's vtables of the functions that the hooks replace; None if not found."""
        slots = private_layout.probe_vtable_slots(self.api)
        if slots is None and self.refusal is None:
            self.refusal = "the functions for samples were not found in this library"
        return slots

    def lend_hooks(self, type_object: Sertype, *, is_reply: bool) -> SampleIdentities | None:
        """Return sample hooks for an unmodified type object, which no other domain uses until `release_hooks`.

        Returns:
            None if samples have an unknown layout; `refusal` is the reason.
        """
        slots, address, payload_offset = self.slots, type_object.address, type_object.payload_offset
        if slots is None:
            return None
        with self._lock:
            existing = self._hooks[private_layout.vtable_address(address, SAMPLE_FUNCTIONS), is_reply]
            if payload_offset is None or any(hooks.payload_offset != payload_offset for hooks in existing):
                self.refusal = "payloads do not have a constant offset in samples"
                return None
            hooks = next((hooks for hooks in existing if not hooks.is_lent), None)
            if hooks is None:
                size_offset = private_layout.probe_size_offset(self.api, address, payload_offset)
                if size_offset is None:
                    self.refusal = "the layout of samples is unknown in this library"
                    return None
                hooks = SampleIdentities(self, type_object, slots, size_offset, is_reply=is_reply)
                existing.append(hooks)
            hooks.is_lent = True
            return hooks

    def release_hooks(self, hooks: SampleIdentities) -> None:
        """Undo `lend_hooks`, after the domain was deleted."""
        hooks.enable_receive_hook(False)
        hooks.is_lent = False

    def append_inline_qos(self, iov: int, writer_id: bytes, inline_qos: bytes) -> None:
        """Append inline QoS to the packet that an iovec belongs to, if a packet of the writer is being built.

        On unexpected data, refuse services of Fast DDS peers from now on.
        """
        try:
            self.packets.append_inline_qos(iov, writer_id, inline_qos)
        except Exception as err:  # must not reach Cyclone
            self.disable(f"a packet to send, {err}")


def _untested_platform() -> str | None:
    system, bits = platform.system(), 8 * private_layout.WORD
    if (system, bits, sys.byteorder) == ("Linux", 64, "little"):
        return None
    return f"not tested on {system} with {bits} bits, {sys.byteorder}-endian"


# ----------------------------------------------------------------------------------------------------------- one domain

_LOOKUP_REPLY = b"DDS::Builtin::TypeLookup_Reply"
_PROBE_TYPE = "rosidl_py_gen_neighbour"
"""Name of a type that is created in a domain only to find the builtin type `TypeLookup_Reply` from its type object."""


class FastDdsInterop:
    """Interoperation with Fast DDS peers in one domain; it exists while the domain is open.

    Receive hooks (functions of ours that replace functions of Cyclone for received samples) are active while a Fast DDS
    participant may exist in the domain, so no request can arrive without a hook.
    """

    def __init__(self, support: FastDdsSupport) -> None:
        self.support = support
        self._hooks: dict[tuple[int, bool], SampleIdentities] = {}
        """Sample hooks by the address of Cyclone's original vtable, and True for replies."""
        self._hooks_by_type: dict[int, SampleIdentities] = {}
        """Sample hooks by the address of the type object that has them."""
        self.members: set[FastDdsPeers] = set()
        """Peers of each participant of this process in the domain. Lock: `lock` must be held."""
        self.lock = threading.Lock()
        """Lock of the hooks and of `members`; never held in a call into Cyclone that takes a lock."""

    def drop_type_lookups(self, create_topic: Callable[[str], object]) -> None:
        """Make Cyclone drop replies of type lookups between peers if they crash the loaded version.

        `create_topic` creates a topic with a type name. Called before the first peer can reply.
        """
        if self.support.crashes_on_type_lookups:
            create_topic(_PROBE_TYPE)  # which calls `prepare`

    def _drop_type_lookups(self, neighbour: int) -> None:
        # eclipse-cyclonedds/cyclonedds issue 2329, before 11: requests for types between two nodes of Kilted on Fast
        # DDS crash Cyclone in `ddsi_xt_type_init_impl` (docs/internals/dds.md 8, docs/internals/cyclone_memory.md 9).
        support, slots = self.support, self.support.slots
        type_object = private_layout.find_type_of_domain(neighbour, _LOOKUP_REPLY, support.api.sertype_version)
        if slots is None or not type_object:
            support.lookup_refusal = "the type of their replies was not found in this library"
            return
        private_layout.replace_vtable_function(
            type_object, SAMPLE_FUNCTIONS, slots.from_ser, ct.cast(create_no_sample, ct.c_void_p).value
        )

    def prepare(self, type_object: Sertype, dds_type: str) -> None:
        """Install the sample hooks in a new type object, if its type is one of requests or replies."""
        is_reply, address, support = dds_type.endswith("_Response_"), type_object.address, self.support
        if dds_type == _PROBE_TYPE:
            self._drop_type_lookups(address)
        if support.refusal is not None or not (is_reply or dds_type.endswith("_Request_")):
            return
        slots, key = support.slots, (private_layout.vtable_address(address, SAMPLE_FUNCTIONS), is_reply)
        if slots is None:
            return
        with self.lock:
            hooks = self._hooks.get(key)
            if hooks is None:
                hooks = support.lend_hooks(type_object, is_reply=is_reply)
                if hooks is None:
                    return
                self._hooks[key] = hooks
                hooks.enable_receive_hook(True)  # until the participants were read
            elif hooks.payload_offset != type_object.payload_offset:
                support.refusal = "payloads do not have a constant offset in samples"
                return
            self._hooks_by_type[address] = hooks
        # Both vtables of the type object are replaced (docs/internals/cyclone_memory.md 4).
        # Otherwise endpoints would get derived sertypes with the original functions for samples.
        private_layout.replace_vtable_function(address, TYPE_FUNCTIONS, slots.derive_sertype, None)
        private_layout.set_vtable(address, SAMPLE_FUNCTIONS, hooks.table)

    def identities_of(self, type_object: int) -> SampleIdentities | None:
        """Return what reads and writes identities of samples of a type, by the address of its type object.

        Returns:
            None for types of topics, and if the loaded library does not support sample identities.
        """
        return self._hooks_by_type.get(type_object)

    def enable_receive_hooks(self, is_enabled: bool) -> None:
        """Activate or deactivate the receive hooks. Lock: `lock` must be held."""
        for hooks in self._hooks.values():
            hooks.enable_receive_hook(is_enabled)

    def close(self) -> None:
        """Release the hooks for other domains. Called after the domain was deleted."""
        with self.lock:
            hooks = list(self._hooks.values())
            self._hooks.clear()
            self._hooks_by_type.clear()
        for one in hooks:
            self.support.release_hooks(one)
