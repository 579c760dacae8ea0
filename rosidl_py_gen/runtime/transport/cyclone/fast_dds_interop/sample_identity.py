"""Sample identities of requests and replies of Fast DDS peers, which Cyclone neither reads nor writes.

rmw_fastrtps sends bare messages, with the DDS-RPC sample identity as RTPS inline QoS. Cyclone's functions for samples
are entries of a vtable. The types of services get a copy of it with two hooks:

- Receive (`from_ser`): call the original; read the inline QoS of the first fragment's submessage; create a second
  sample with the identity embedded (`correlation.embed_identity`), and release the first.
- Send (`to_ser_ref`): the sample is created with a hidden prefix (random magic, writer id, encoded inline QoS), and its
  size field is reduced by the prefix, so that Cyclone sees only the message. When Cyclone requests the bytes for the
  first fragment, the hook appends the inline QoS to the header in the packet; all fragments are shifted past the
  prefix. This holds for retransmissions, too. Readers of this process get no packet, but
  the sample itself; the taking reader embeds the identity.

Rules, each with a test:

- Only `private_layout.py` knows offsets. If a probe fails, and after the first packet with unexpected bytes, services
  of Fast DDS peers are refused; nothing is guessed.
- Hooks run in Cyclone's threads, with locks of Cyclone held. They take no lock, call only functions of Cyclone that
  allocate and copy, do not log and never raise.
- The receive hook adds half to the time of a service call, so it is active only while a Fast DDS participant may exist.
  Cyclone reports a new participant in its own thread, before it processes anything else of it: `FastDdsInterop` in
  `interop.py` then activates the hook in `on_participants_pending`. A reader of the builtin topic calls `begin_read`,
  reads, and calls `end_read` with the result. The hook is deactivated when no Fast DDS participant is known and no
  builtin reader has unread data. That order leaves no gap in which a request could arrive without the hook.
- Hooks must not run after the interpreter has ended: contexts are closed at exit, which ends Cyclone's threads.

Source: docs/internals/dds.md 2 to 5; docs/internals/protocol.md 5.3.
"""

from __future__ import annotations

import ctypes as ct
import os
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.runtime.transport.cyclone import c_api, private_layout
from rosidl_py_gen.runtime.transport.cyclone.c_api import SAMPLE_WITH_DATA, address_of, pack_iov
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop import rtps
from rosidl_py_gen.runtime.transport.cyclone.private_layout import SAMPLE_FUNCTIONS, bytes_at
from rosidl_py_gen.runtime.transport.dds.correlation import (
    IDENTITY_BYTES,
    SampleIdentity,
    embed_identity,
)
from rosidl_py_gen.runtime.transport.foreign_threads import retain_thread_state

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.cyclone.domain import Sertype
    from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.interop import FastDdsInterop

_BAD_PARAMETER = -3
_DISCARDED = 1
"""Result of `from_ser` after 11.0.1 that, like NULL, means that no sample was created."""
_IDENTITY_MAGIC = b"\0\1" + os.urandom(6)
"""First bytes of the hidden prefix. They are random, so that received data cannot imitate them."""
_INLINE_QOS_OFFSET = len(_IDENTITY_MAGIC) + 4
_PREFIX_BYTES = _INLINE_QOS_OFFSET + rtps.INLINE_QOS_BYTES
"""Length of the hidden prefix: magic, writer id, inline QoS."""

_Ptr, _Size = ct.c_void_p, ct.c_size_t
_FromSer = (_Ptr, _Ptr, ct.c_int, _Ptr, _Size)
_ToSerRef = (_Ptr, _Ptr, _Size, _Size, _Ptr)
create_no_sample = ct.CFUNCTYPE(*_FromSer)(lambda *_: None)
"""Receive hook that drops all samples."""


class SampleHooks:
    """Vtable for samples of requests, or of replies: a copy of Cyclone's, with the hooks."""

    def __init__(
        self,
        owner: FastDdsInterop,
        type_object: Sertype,
        slots: private_layout.VtableSlots,
        size_offset: int,
        *,
        is_reply: bool,
    ) -> None:
        self._owner = owner
        self._is_reply = is_reply
        self._slots = slots
        self._size_offset = size_offset
        self.payload_offset = type_object.payload_offset or 0
        self.table = private_layout.copy_vtable(type_object.address, SAMPLE_FUNCTIONS)
        self._plain_from_ser = ct.PYFUNCTYPE(*_FromSer)(self.table[slots.from_ser] or 0)
        self._plain_to_ser_ref = ct.PYFUNCTYPE(*_ToSerRef)(self.table[slots.to_ser_ref] or 0)
        self._from_ser_hook = ct.CFUNCTYPE(*_FromSer)(self._from_ser)
        self._to_ser_ref_hook = ct.CFUNCTYPE(*_ToSerRef)(self._to_ser_ref)
        self._from_ser_functions = (self.table[slots.from_ser], ct.cast(self._from_ser_hook, _Ptr).value)
        self.sends = False
        """Samples with an identity were written."""

    def enable_receive_hook(self, is_enabled: bool) -> None:
        """Activate or deactivate the receive hook."""
        self.table[self._slots.from_ser] = self._from_ser_functions[is_enabled]

    def write(self, entity: int, writer_id: bytes, type_object: int, data: bytes, identity: SampleIdentity) -> int:
        """Send a sample with an identity in the hidden prefix; return the code of Cyclone.

        Args:
            data: message with its encapsulation header; the length is a multiple of 4.
        """
        api, code = self._owner.api, _BAD_PARAMETER
        sample = private_layout.new_sample(
            api, type_object, _IDENTITY_MAGIC + writer_id + rtps.encode_inline_qos(identity) + data
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
        """Send a sample without identity; return the code of Cyclone."""
        write = self._owner.api.bare_write
        # Once a sample with an identity was sent, Cyclone calls the send hook for all samples.
        return c_api.call_with_sigint_deferred(write, entity, sample) if self.sends else write(entity, sample)

    def with_embedded_identity(self, sample: int, size: int) -> bytes | None:
        """Return the payload of a sample of this process with its identity embedded; None if it has no identity.

        Args:
            size: payload size in Cyclone.
        """
        if (
            size < len(_IDENTITY_MAGIC)
            or bytes_at(sample + self.payload_offset, len(_IDENTITY_MAGIC)) != _IDENTITY_MAGIC
        ):
            return None
        data = bytes_at(sample + self.payload_offset, _PREFIX_BYTES + size)
        return embed_identity(data[_PREFIX_BYTES:], rtps.decode_inline_qos(data[_INLINE_QOS_OFFSET:_PREFIX_BYTES]))

    def _from_ser(self, type_object: int, kind: int, fragment: int, size: int) -> Any:
        """Create a sample from received fragments. Called by Cyclone; must not raise, block or log."""
        owner = self._owner
        retain_thread_state()
        plain = self._plain_from_ser(type_object, kind, fragment, size)
        if plain in (None, _DISCARDED) or kind != SAMPLE_WITH_DATA or owner.refusal is not None:
            return plain
        try:
            identity = rtps.read_submessage(*owner.packets.read_received(fragment), is_reply=self._is_reply)
        except Exception as err:  # must not reach Cyclone
            owner.disable(f"a received sample, {err!r}")
            identity = None
        if identity is None:
            return plain
        begin = plain + self.payload_offset
        head = embed_identity(bytes_at(begin, 4), identity)
        iov = pack_iov(address_of(head), len(head)) + pack_iov(begin + 4, size - 4)
        sample = owner.api.serdata_from_ser_iov(type_object, kind, 2, iov, size + IDENTITY_BYTES)
        owner.api.serdata_unref(plain)
        return sample

    def _to_ser_ref(self, sample: int, offset: int | None, size: int, iov: int) -> Any:
        """Set the iovec of a fragment, and add inline QoS to the first one. Called by Cyclone; must not raise."""
        result = self._plain_to_ser_ref(sample, offset or 0, size, iov)
        begin = sample + self.payload_offset
        if bytes_at(begin, len(_IDENTITY_MAGIC)) == _IDENTITY_MAGIC:
            if not offset:
                prefix = bytes_at(begin + len(_IDENTITY_MAGIC), 4 + rtps.INLINE_QOS_BYTES)
                self._owner.append_inline_qos(iov, prefix[:4], prefix[4:])
            private_layout.write_iovec(iov, begin + _PREFIX_BYTES + (offset or 0), size)
        return result
