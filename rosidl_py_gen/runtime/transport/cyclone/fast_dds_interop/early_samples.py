"""Makes readers ask writers on Fast DDS for what those sent before Cyclone had heard a heartbeat of them.

A writer on Fast DDS connects with our reader, says in a heartbeat that nothing was written yet, and writes. Cyclone
knows the writer a moment later: a millisecond as a rule, up to a second in a new network. Heartbeat and samples that
came earlier are gone, and the next heartbeat comes up to 3 s after the first. Cyclone takes what that one tells of for
history that a volatile reader does not want, so that a request, or a half-received message of many fragments, is never
asked for. (Writers on Cyclone say nothing of the kind before their first heartbeat was answered.)

When it connects a reader with a writer, Cyclone looks at a flag that says whether the reader is transient local, which
means: ask for all that the writer has. Nothing else looks at that flag, and here all reliable readers get it. History
does not arrive for that: a writer keeps nothing for volatile readers, and says so when asked.

With the flag nothing has to be done in time. A forged heartbeat to ourselves, sent when discovery has told of a writer,
was tried: it helps only behind the connection and before the writer's own. For writers that are known when a reader is
created the flag has to be set during the creation: when Cyclone tells a listener that it is about to connect the first
one, in the creating thread.
"""

from __future__ import annotations

import ctypes as ct
from contextlib import suppress
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.api import TransportError
from rosidl_py_gen.runtime.transport.cyclone import c_api, private_layout

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.sample_identity import FastDdsInterop


class EarlySampleReaders:
    """Creates readers that want what was sent early, where those of Cyclone look as known; others as they are."""

    def __init__(self, api: c_api.CycloneApi, fast_dds: FastDdsInterop, listener: int) -> None:
        """`listener` is what the readers have in the end."""
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
        """Find out how readers look: from one of a builtin topic, of which no peer is told."""
        fast_dds = self._fast_dds
        if fast_dds.reader_place is None and not fast_dds.early_refusal:
            with self._api.locked_entity(builtin_reader) as address:
                fast_dds.reader_place = private_layout.probe_reader_offsets(address, self._api.guid_of(builtin_reader))
            if fast_dds.reader_place is None:
                fast_dds.early_refusal = "readers do not look as known in this library"

    def create_reader(self, create: Callable[[int], int], *, is_reliable: bool) -> int:
        """The handle of a reader; `create` gets the listener to create it with."""
        if self._fast_dds.early_refusal:
            return create(self._listener)
        entity: int = c_api.call_with_sigint_deferred(create, self._during_creation)
        self._api.set_listener(entity, self._listener)
        self._request_history(entity, is_reliable)
        return entity

    def _on_subscription_matched(self, entity: int, *_: object) -> None:
        """Called by Cyclone, with what it tells listeners."""
        self._request_history(entity, None)

    def _request_history(self, entity: int, is_reliable: bool | None) -> None:
        """Set the flag, unless the reader is gone."""
        place, wrong = self._fast_dds.reader_place, None
        if place is not None:
            with suppress(TransportError), self._api.locked_entity(entity) as address:
                wrong = private_layout.set_requests_history(address, place, self._api.guid_of(entity), is_reliable)
        if wrong is not None:
            self._fast_dds.early_refusal = f"Cyclone DDS does not behave as known: {wrong}"

    def close(self) -> None:
        """When the readers are deleted."""
        self._api.delete_listener(self._during_creation)
