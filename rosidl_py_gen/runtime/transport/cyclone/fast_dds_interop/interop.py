"""Interoperation of one domain with Fast DDS: the types of services that have sample identities."""

from __future__ import annotations

import ctypes as ct
import threading
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.cyclone import private_layout
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.sample_identity import SampleIdentities, create_no_sample
from rosidl_py_gen.runtime.transport.cyclone.private_layout import SAMPLE_FUNCTIONS, TYPE_FUNCTIONS

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.cyclone.domain import Sertype
    from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.peers import FastDdsPeers
    from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.support import FastDdsSupport

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
