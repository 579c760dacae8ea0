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
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.cyclone import abi

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.cyclone.fastdds import FastDds

_READER_KIND = 5
_RELIABLE, _WANTS_ALL = 1, 2


class EarlySamples:
    """Creates readers that want what was sent early, where the structures of Cyclone are known; others as they are."""

    def __init__(self, api: abi.Api, fast_dds: FastDds, listener: int) -> None:
        """`listener` is what the readers have in the end."""
        self._api = api
        self._fast_dds = fast_dds
        self._listener = listener
        self._on_matched = ct.CFUNCTYPE(None, ct.c_int32, abi.MatchedStatus, ct.c_void_p)(self._ask)
        self._during_creation: int = api.create_listener(None)
        api.copy_listener(self._during_creation, listener)
        api.lset_subscription_matched_arg(self._during_creation, ct.cast(self._on_matched, ct.c_void_p), None, True)

    def create_reader(self, create: Callable[[int], int]) -> int:
        """The handle of a reader; `create` gets the listener to create it with."""
        if self._fast_dds.refusal is not None:
            return create(self._listener)
        entity: int = abi.undisturbed(create, self._during_creation)
        self._api.set_listener(entity, self._listener)
        self._ask(entity)
        return entity

    def _ask(self, entity: int, *_: object) -> None:
        """Set the flag. Called by Cyclone as well, with what it tells listeners."""
        layout, guid, pinned = self._fast_dds.layout, ct.create_string_buffer(16), ct.c_void_p()
        if self._api.get_guid(entity, guid) != 0 or self._api.entity_pin(entity, ct.byref(pinned)) != 0:
            return
        try:
            reader = ct.c_uint64.from_address((pinned.value or 0) + layout.entity_reader).value
            head = bytes((ct.c_ubyte * 20).from_address(reader))
            flags = ct.c_ubyte.from_address(reader + layout.reader_flags)
            if head != _READER_KIND.to_bytes(4, "little") + _in_words(guid.raw):
                self._fast_dds.distrust(f"a reader, {head.hex()}")
            elif flags.value & _RELIABLE:
                flags.value |= _WANTS_ALL
        finally:
            self._api.entity_unpin(pinned)

    def close(self) -> None:
        """When the readers are deleted."""
        self._api.delete_listener(self._during_creation)


def _in_words(guid: bytes) -> bytes:
    """A GUID as Cyclone keeps it: four numbers in the byte order of this machine, which is little-endian."""
    return b"".join(guid[at : at + 4][::-1] for at in range(0, 16, 4))
