"""Sample identities in requests and replies of Fast DDS peers, which Cyclone neither reads nor writes.

rmw_fastrtps sends bare messages, with the DDS-RPC sample identity as RTPS inline QoS. The types of services get a copy
of Cyclone's function table for samples, with two hooks (docs/internals/dds.md 3 and 4): `from_ser` receives a sample,
`to_ser_ref` sends one. Bytes of packets come from the network: any content is possible.

Thread rules: hooks run in Cyclone's threads, with locks of Cyclone held. They take no lock, call only functions of
Cyclone that allocate and copy, do not log and never raise.

Source: docs/internals/protocol.md 5.3, docs/internals/dds.md 3 to 5; OMG DDSI-RTPS 2.3, 9.4 and 9.6.
"""

from __future__ import annotations

import ctypes as ct
import os
import struct
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.runtime.transport.cyclone import c_api, private_layout
from rosidl_py_gen.runtime.transport.cyclone.c_api import SAMPLE_WITH_DATA, address_of, pack_iov
from rosidl_py_gen.runtime.transport.cyclone.private_layout import (
    DATA,
    DATA_BYTES,
    DATA_FRAG,
    INLINE_QOS_FLAG,
    SAMPLE_FUNCTIONS,
    bytes_at,
)
from rosidl_py_gen.runtime.transport.dds.correlation import IDENTITY_BYTES, SampleIdentity, embed_identity
from rosidl_py_gen.runtime.transport.foreign_threads import retain_thread_state

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.cyclone.domain import Sertype
    from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.support import FastDdsSupport

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
            code = c_api.call_with_sigint_deferred(api.writecdr, entity, sample)
        else:
            self._owner.disable("the size of a sample")
        if code in c_api.SAMPLE_NOT_CONSUMED:
            api.serdata_unref(sample)
        return code

    def write_plain(self, entity: int, sample: ct.c_void_p) -> int:
        """Send a sample without identity; return Cyclone's return code."""
        write = self._owner.api.bare_write
        # Once a sample with an identity was sent, Cyclone calls the send hook for all samples.
        return c_api.call_with_sigint_deferred(write, entity, sample) if self.sends else write(entity, sample)

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
