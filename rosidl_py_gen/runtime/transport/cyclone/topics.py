"""Topics, and the type objects ("sertypes") of Cyclone that they share.

Decides that one opaque type stands for every ROS type. A true description of a PointCloud2 takes 3 ms to build, there
is none for wstrings, and with it C drops samples it dislikes (bool 2, missing NUL) silently; opaque ones arrive and are
counted. Types of different names are different to Cyclone.

Our endpoints announce no type information, as those of rmw_cyclonedds: two that both announce it are compared by it,
and ours would say nothing about the ROS type. Without it names decide, with every peer.

Rule: one type object for each domain and type, for as long as the domain is open. A second one would be equal by one of
Cyclone's comparisons and different by another, and its hash table grows without end.

Source: docs/internals/dds.md 1.
"""

from __future__ import annotations

import ctypes as ct
import threading
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.runtime.transport.api import TransportError
from rosidl_py_gen.runtime.transport.cyclone import private_layout
from rosidl_py_gen.runtime.transport.cyclone.c_api import TopicDescriptor

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.cyclone.c_api import CycloneApi

_LONGEST_TYPE = 255
"""What peers may not take, and a limit of earlier versions."""
_OPS = (ct.c_uint32 * 3)(0x01010000, 0, 0)
"""``struct opaque { octet data; }``: an octet at 0, the end."""


class Sertype(NamedTuple):
    """What stands for a type in a domain.

    Attributes:
        content: how far behind the beginning of a sample its bytes lie; None when a copy has to be asked for.
    """

    address: int
    content: int | None


class Sertypes:
    """The type objects of one domain."""

    def __init__(self, api: CycloneApi, prepare: Callable[[Sertype, str], None]) -> None:
        """`prepare` is called with each new type object and its type's name."""
        self._api = api
        self._prepare = prepare
        self._lock = threading.Lock()
        self._known: dict[str, Sertype] = {}

    def create_topic(self, participant: int, topic: str, dds_type: str) -> int:
        """A new topic entity."""
        if len(dds_type) > _LONGEST_TYPE:
            raise TransportError(
                f"the DDS name of a type may have {_LONGEST_TYPE} characters, found {len(dds_type)}: {dds_type[:60]}..."
            )
        api = self._api
        what = f"create topic {topic} ({dds_type})"
        with self._lock:
            known = self._known.get(dds_type)
            if known is not None:
                used_up = ct.c_void_p(api.sertype_ref(known.address))
                return api.check(
                    api.create_topic_sertype(participant, topic.encode(), ct.byref(used_up), None, None, None), what
                )
            descriptor = TopicDescriptor(
                size=1, align=1, type_name=dds_type.encode(), op_count=len(_OPS), ops=ct.addressof(_OPS)
            )  # which is copied
            entity = api.check(api.create_topic(participant, ct.byref(descriptor), topic.encode(), None, None), what)
            address = self._type_of(entity, dds_type)
            if address is None:
                raise TransportError(
                    f"Cyclone DDS could not {what}: this library has no dds_get_entity_sertype, and the type was not "
                    "found where others have it; take another libddsc"
                )
            found = self._known[dds_type] = Sertype(
                api.sertype_ref(address), private_layout.probe_payload_offset(api, address)
            )
            self._prepare(found, dds_type)
            return entity

    def _type_of(self, topic: int, dds_type: str) -> int | None:
        api = self._api
        if api.get_entity_sertype is None:
            with api.locked_entity(topic) as address:
                return private_layout.probe_sertype(address, dds_type.encode(), api.sertype_version)
        found = ct.c_void_p()
        api.check(api.get_entity_sertype(topic, ct.byref(found)), f"find the type {dds_type}")
        return found.value

    def __getitem__(self, dds_type: str) -> Sertype:
        """That of a type that has topics."""
        return self._known[dds_type]

    def close(self) -> None:
        """Give the type objects back, before the domain is deleted."""
        with self._lock:
            for known in self._known.values():
                self._api.sertype_unref(known.address)
            self._known.clear()
