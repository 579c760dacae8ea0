"""Topics, and the sertypes (type objects) of Cyclone that they share.

One opaque type represents every ROS type. A true description of a PointCloud2 takes 3 ms to build, does not exist for
wstrings, and makes C drop invalid samples (bool 2, missing NUL) silently. Opaque samples arrive and are counted. Types
with different names are different to Cyclone.

Endpoints announce no type information, as those of rmw_cyclonedds: two endpoints that both announce it are compared by
it, and ours would not describe the ROS type. Without it, names are compared with every peer.

Invariant: there is one sertype for each domain and type while the domain is open. A second one would be equal by one
comparison of Cyclone and different by another, and Cyclone's hash table would grow without end.

Source: docs/internals/dds.md 1.
"""

from __future__ import annotations

import ctypes as ct
import threading
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.runtime.transport.api import TransportError
from rosidl_py_gen.runtime.transport.cyclone import private_layout
from rosidl_py_gen.runtime.transport.cyclone.c_api import CycloneApi, TopicDescriptor

if TYPE_CHECKING:
    from collections.abc import Callable


_MAX_TYPE_CHARS = 255
"""Maximum length of a type name: a limit of earlier versions and maybe of peers."""
_OPS = (ct.c_uint32 * 3)(0x01010000, 0, 0)
"""Serializer program of ``struct opaque { octet data; }``: an octet at offset 0, end."""


class Sertype(NamedTuple):
    """Type object of a domain.

    Attributes:
        payload_offset: offset of the payload in a sample; None if payloads must be copied by Cyclone.
    """

    address: int
    payload_offset: int | None


class Sertypes:
    """Type objects of one domain; `prepare` is called with each new one and the name of its type."""

    def __init__(self, api: CycloneApi, prepare: Callable[[Sertype, str], None]) -> None:
        self._api = api
        self._prepare = prepare
        self._lock = threading.Lock()
        self._known: dict[str, Sertype] = {}

    def create_topic(self, participant: int, topic: str, dds_type: str) -> int:
        """Create a topic entity."""
        if len(dds_type) > _MAX_TYPE_CHARS:
            raise TransportError(
                f"DDS type {dds_type[:60]}...: expected at most {_MAX_TYPE_CHARS} characters, got {len(dds_type)}"
            )
        api = self._api
        activity = f"create topic {topic} ({dds_type})"
        with self._lock:
            known = self._known.get(dds_type)
            if known is not None:
                reference = ct.c_void_p(api.sertype_ref(known.address))  # which the call consumes
                code = api.create_topic_sertype(participant, topic.encode(), ct.byref(reference), None, None, None)
                return api.check(code, activity)
            descriptor = TopicDescriptor(
                size=1, align=1, type_name=dds_type.encode(), op_count=len(_OPS), ops=ct.addressof(_OPS)
            )  # which Cyclone copies
            code = api.create_topic(participant, ct.byref(descriptor), topic.encode(), None, None)
            entity = api.check(code, activity)
            address = self._type_of(entity, dds_type)
            if address is None:
                raise TransportError(
                    f"Cyclone DDS could not {activity}: the library has no dds_get_entity_sertype, and the type was "
                    "not found in the topic; use another libddsc"
                )
            payload_offset = private_layout.probe_payload_offset(api, address)
            known = self._known[dds_type] = Sertype(api.sertype_ref(address), payload_offset)
            self._prepare(known, dds_type)
            return entity

    def _type_of(self, topic: int, dds_type: str) -> int | None:
        api = self._api
        if api.get_entity_sertype is None:
            with api.locked_entity(topic) as address:
                return private_layout.probe_sertype(address, dds_type.encode(), api.sertype_version)
        address = ct.c_void_p()
        api.check(api.get_entity_sertype(topic, ct.byref(address)), f"find the type {dds_type}")
        return address.value

    def __getitem__(self, dds_type: str) -> Sertype:
        """Return the sertype of a type that has topics."""
        return self._known[dds_type]

    def close(self) -> None:
        """Release all sertypes. Called before the domain is deleted."""
        with self._lock:
            for known in self._known.values():
                self._api.sertype_unref(known.address)
            self._known.clear()
