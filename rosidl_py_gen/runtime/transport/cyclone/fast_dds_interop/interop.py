"""State of the interoperation with Fast DDS: hooks in Cyclone, capabilities, and reasons why some are missing."""

from __future__ import annotations

import ctypes as ct
import platform
import sys
import threading
from functools import cached_property
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.api import DiscoveryEvent, EntityLost
from rosidl_py_gen.runtime.transport.cyclone import private_layout
from rosidl_py_gen.runtime.transport.cyclone.config import IGNORE_TYPE_INFORMATION
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.sample_identity import SampleHooks, create_no_sample
from rosidl_py_gen.runtime.transport.cyclone.private_layout import SAMPLE_FUNCTIONS, TYPE_FUNCTIONS
from rosidl_py_gen.runtime.transport.dds.correlation import uses_sample_identity

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from rosidl_py_gen.runtime.transport.cyclone.c_api import CycloneApi
    from rosidl_py_gen.runtime.transport.cyclone.domain import Sertype

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
        "Fast DDS nodes that ask each other for types, as those of Kilted do, may end this process",
    ),
    ("loopback_refusal", "localhost mode on the loopback interface alone", ""),
)
"""Capabilities that not every libddsc has. Each is a tuple: attribute with the reason why the capability is missing,
name in `Context.capabilities` and `rosidl-py doctor`, and warning that is logged when a Fast DDS node is discovered."""
_LOOKUP_REPLY = b"DDS::Builtin::TypeLookup_Reply"
PROBE_TYPE = "rosidl_py_gen_neighbour"
"""Name of a type that is created in a domain only because its type object leads to the builtin type `TypeLookup_Reply`.
"""


class FastDdsInterop:
    """Interoperation with Fast DDS peers; one object for the process.

    Receive hooks are Python functions that replace functions of Cyclone for received samples. They are active while a
    Fast DDS participant may exist, so no request can arrive without a hook.
    """

    def __init__(self, api: CycloneApi, unsupported: Collection[str] = ()) -> None:
        self.api = api
        self.packets = private_layout.PacketAccess()
        self.refusal: str | None = _untested_platform()
        """Reason why services of Fast DDS peers cannot be used; None if they can be used."""
        self.reader_offsets: private_layout.ReaderOffsets | None = None
        self.early_refusal = self.refusal or ""
        """Reason why early samples of Fast DDS peers are not requested; empty if they are requested."""
        self.lookup_refusal = ""
        """Reason why type lookups between Fast DDS peers are not dropped; empty if they are dropped or need not be
        dropped."""
        self.loopback_refusal = _UNBOUND if IGNORE_TYPE_INFORMATION in unsupported else ""
        """Reason why localhost mode uses other interfaces than loopback; empty if it uses loopback alone."""
        self._warned: set[str] = set()
        self._samples: dict[tuple[int, bool], SampleHooks] = {}
        """Hooks by the address of the function table of Cyclone that they replace, each with True if they are for
        replies."""
        self._tables: dict[int, SampleHooks] = {}
        """Hooks by the address of their own function table, which replaces Cyclone's."""
        self._lock = threading.Lock()
        """Lock of the hooks and of `_unread` and `_peers`; never held in a call into Cyclone that takes a lock."""
        self._unread: set[int] = set()
        """Builtin readers of participants with unread data."""
        self._peers: set[tuple[int, bytes]] = set()
        """Fast DDS participants, each with the builtin reader that reported it."""

    def capabilities(self) -> dict[str, str]:
        """Return each capability with ``"yes"``, or the reason why it is missing; "yes" as well if not yet probed."""
        return {name: getattr(self, reason) or "yes" for reason, name, _ in _CAPABILITIES}

    def new_warnings(self) -> list[str]:
        """Return warnings about missing capabilities that were not returned before; none without Fast DDS peers."""
        reasons = [(warning, getattr(self, reason)) for reason, _, warning in _CAPABILITIES if warning]
        warnings = [f"{warning}: {reason}" for warning, reason in reasons if reason] if self._peers else []
        new = [warning for warning in warnings if warning not in self._warned]
        self._warned.update(new)
        return new

    def disable(self, unexpected: str) -> None:
        """Stop using services of Fast DDS peers, because unexpected data was found in Cyclone's memory."""
        self.refusal = f"unexpected data in Cyclone DDS: {unexpected}"

    @cached_property
    def slots(self) -> private_layout.VtableSlots | None:
        """Positions of the functions that hooks replace in function tables of Cyclone; None if they were not found."""
        slots = private_layout.probe_vtable_slots(self.api)
        if slots is None and self.refusal is None:
            self.refusal = "the functions for samples were not found in this library"
        return slots

    def _drop_type_lookups(self, neighbour: int) -> None:
        """Make Cyclone drop replies of type lookups between peers, which crash some versions of Cyclone.

        `neighbour` is the address of any type object of the domain.
        """
        slots = self.slots
        # eclipse-cyclonedds/cyclonedds issue 2329, before 11: requests for types between two nodes of Kilted on Fast
        # DDS crash Cyclone in `ddsi_xt_type_init_impl` (docs/internals/dds.md 8).
        type_object = private_layout.find_type_of_domain(neighbour, _LOOKUP_REPLY, self.api.sertype_version)
        if slots is None or not type_object:
            self.lookup_refusal = "the type of their replies was not found in this library"
            return
        private_layout.replace_vtable_function(
            type_object, SAMPLE_FUNCTIONS, slots.from_ser, ct.cast(create_no_sample, ct.c_void_p).value
        )

    def prepare(self, type_object: Sertype, dds_type: str) -> None:
        """Install the hooks in a new type object, if its type is a request or a reply of a service.

        For `PROBE_TYPE`, make Cyclone drop type lookups of the domain instead.
        """
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
            payload_offset = type_object.payload_offset
            if payload_offset is None or (samples is not None and samples.payload_offset != payload_offset):
                self.refusal = "payloads do not have a constant offset in samples"
                return
            if samples is None:
                size_offset = private_layout.probe_size_offset(self.api, address, payload_offset)
                if size_offset is None:
                    self.refusal = "the layout of samples is unknown in this library"
                    return
                samples = SampleHooks(self, type_object, slots, size_offset, is_reply=is_reply)
                self._samples[original, is_reply] = samples
                self._tables[ct.addressof(samples.table)] = samples
                samples.enable_receive_hook(True)  # until the participants were read
        # Otherwise endpoints would get derived sertypes with the original functions for samples.
        private_layout.replace_vtable_function(address, TYPE_FUNCTIONS, slots.derive_sertype, None)
        private_layout.set_vtable(address, SAMPLE_FUNCTIONS, samples.table)

    def on_participants_pending(self, reader: int) -> None:
        """Activate the receive hooks, because a builtin reader of participants has unread data. Called by Cyclone."""
        # Cyclone reports a new participant in its own thread, before it processes anything else of the participant.
        with self._lock:
            self._unread.add(reader)
            self._enable_receive_hooks(True)

    def begin_read(self, reader: int) -> None:
        """Record that the caller starts to take all data of a builtin reader of participants.

        The caller must then call `end_read`.
        """
        with self._lock:
            self._unread.discard(reader)

    def end_read(self, reader: int, events: Iterable[DiscoveryEvent]) -> None:
        """Update the set of Fast DDS participants by the events of a builtin reader of participants.

        Without Fast DDS participants and unread data, the receive hooks are deactivated.
        """
        with self._lock:
            for event in events:
                if isinstance(event, EntityLost):
                    self._peers.discard((reader, event.guid))
                elif uses_sample_identity(event.guid):
                    self._peers.add((reader, event.guid))
            # Data that became unread since `begin_read` may be about a Fast DDS participant.
            if not self._peers and not self._unread:
                self._enable_receive_hooks(False)

    def forget_reader(self, reader: int) -> None:
        """Remove a deleted builtin reader of participants, and the participants that only this reader has reported."""
        with self._lock:
            self._unread.discard(reader)
            self._peers = {peer for peer in self._peers if peer[0] != reader}

    def _enable_receive_hooks(self, is_enabled: bool) -> None:
        for samples in self._samples.values():
            samples.enable_receive_hook(is_enabled)

    def hooks_of(self, type_object: int) -> SampleHooks | None:
        """Return the hooks that are installed in a type object, given by its address; None if there are none."""
        return self._tables.get(private_layout.vtable_address(type_object, SAMPLE_FUNCTIONS))

    def append_inline_qos(self, iov: int, writer_id: bytes, inline_qos: bytes) -> None:
        """Append inline QoS to the packet to which an iovec belongs, if Cyclone is building a packet of the writer.

        On unexpected data, services of Fast DDS peers are not used any more.
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
