"""Support for peers on Fast DDS by the loaded library: results of probes, and reasons why something is missing.

Facts about the library hold for the whole process. Peers are state of a participant (`peers.py`), and types are state
of a domain (`interop.py`).
"""

from __future__ import annotations

import platform
import sys
import threading
from collections import defaultdict
from functools import cached_property
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.cyclone import private_layout
from rosidl_py_gen.runtime.transport.cyclone.config import IGNORE_TYPE_INFORMATION
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.sample_identity import SampleIdentities
from rosidl_py_gen.runtime.transport.cyclone.private_layout import SAMPLE_FUNCTIONS

if TYPE_CHECKING:
    from collections.abc import Collection

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
