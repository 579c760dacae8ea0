"""Readers that request the samples which a Fast DDS writer sent before Cyclone had received a heartbeat of the writer.

A Fast DDS writer matches our reader, sends a heartbeat that nothing was written yet, and writes. Cyclone discovers the
writer later: usually by a millisecond, in a new network up to a second. The heartbeat and the samples before that are
lost, and the next heartbeat comes up to 3 s after the first. Cyclone takes what it announces for history, which a
volatile reader does not need, and never requests it: neither a request nor the missing fragments of a large message.
(Writers of Cyclone announce nothing before their first heartbeat was answered.)

When Cyclone matches a reader with a writer, it reads the flag "transient local" of the reader to decide whether to
request all samples that the writer has. The flag has no other use after creation, so it is set for all reliable
readers. No real history arrives, because a writer retains none for volatile readers, and says so.

With the flag no action depends on timing. (Tried: a forged heartbeat to ourselves after the discovery of a writer. It
helps only between the match and the writer's own heartbeat.) Writers that are known already are matched while the
reader is created. For these the flag is set by a listener that Cyclone calls before the first match, in the creating
thread.
"""

from __future__ import annotations

import ctypes as ct
from contextlib import suppress
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.api import TransportError
from rosidl_py_gen.runtime.transport.cyclone import c_api, private_layout

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.interop import FastDdsInterop


class EarlySampleReaders:
    """Creates readers that request early samples; plain readers if the layout of readers is unknown.

    Args:
        listener: listener of the created readers.
    """

    def __init__(self, api: c_api.CycloneApi, fast_dds: FastDdsInterop, listener: int) -> None:
        self._api = api
        self._fast_dds = fast_dds
        self._listener = listener
        self._on_matched = ct.CFUNCTYPE(None, ct.c_int32, c_api.DdsMatchedStatus, ct.c_void_p)(
            self._on_subscription_matched
        )
        self._during_creation: int = api.create_listener(None)
        api.copy_listener(self._during_creation, listener)
        api.lset_subscription_matched_arg(self._during_creation, ct.cast(self._on_matched, ct.c_void_p), None, True)

    def probe_layout(self, builtin_reader: int) -> None:
        """Find the layout of readers by that of a builtin topic, which is not announced to peers."""
        fast_dds = self._fast_dds
        if fast_dds.reader_offsets is None and not fast_dds.early_refusal:
            with self._api.locked_entity(builtin_reader) as address:
                guid = self._api.guid_of(builtin_reader)
                fast_dds.reader_offsets = private_layout.probe_reader_offsets(address, guid)
            if fast_dds.reader_offsets is None:
                fast_dds.early_refusal = "the layout of readers is unknown in this library"

    def create_reader(self, create: Callable[[int], int], *, is_reliable: bool) -> int:
        """Return the handle of a new reader, which `create` creates with the listener that it gets."""
        if self._fast_dds.early_refusal:
            return create(self._listener)
        entity: int = c_api.call_with_sigint_deferred(create, self._during_creation)
        self._api.set_listener(entity, self._listener)
        self._request_history(entity, is_reliable)
        return entity

    def _on_subscription_matched(self, entity: int, *_: object) -> None:
        """Called by Cyclone; must not raise, block or log."""
        self._request_history(entity, None)

    def _request_history(self, entity: int, is_reliable: bool | None) -> None:
        offsets, unexpected = self._fast_dds.reader_offsets, None
        if offsets is not None:
            with suppress(TransportError), self._api.locked_entity(entity) as address:  # the reader may be deleted
                guid = self._api.guid_of(entity)
                unexpected = private_layout.set_requests_history(address, offsets, guid, is_reliable)
        if unexpected is not None:
            self._fast_dds.early_refusal = f"unexpected data in Cyclone DDS: {unexpected}"

    def close(self) -> None:
        """Delete the listener. Called after the readers were deleted."""
        self._api.delete_listener(self._during_creation)
