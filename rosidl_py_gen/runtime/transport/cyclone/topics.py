"""Topics, and the type objects ("sertypes") of Cyclone that they share.

Decides that one opaque type stands for every ROS type. A true description of a PointCloud2 takes 3 ms to build, there
is none for wstrings, and with it C drops samples it dislikes (bool 2, missing NUL) silently; opaque ones arrive and are
counted. Types of different names are different to Cyclone.

Decides that our endpoints announce no type information, as those of rmw_cyclonedds do. Two endpoints that both announce
it are compared by it, and ours says nothing about the ROS type: peers that announce the true one, rmw_fastrtps from
Kilted on, would not match and say nothing. Without it names decide, with every peer.

How: `ddspy_topic_create` needs a description, because it builds the type object from it. Afterwards the functions
that tell others about it are taken away; Cyclone does without those that are not there.

Rule: one type object for each domain and type, for as long as the domain is open. A second one would be equal by one of
Cyclone's comparisons and different by another, and its hash table grows without end.

Source: docs/internals/dds.md 1 and 2, docs/internals/protocol.md 11.1 and 11.2.
"""

from __future__ import annotations

import ctypes as ct
import threading
from typing import TYPE_CHECKING, ClassVar

from rosidl_py_gen.runtime.transport.port import TransportError

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.cyclone.abi import Api

_LONGEST_TYPE = 255
"""Longer ones crash the library."""
_OPS_WORDS = 14
_TELLING = (8, 9, 10)
"""Places of type_id, type_map and type_info among the functions of a type object."""
OPAQUE = (
    bytes.fromhex(
        "6000000001100040280000002400000014000000f1791554c8b340bad17558190a4efa0027000000000000000400000000000000"
        "02100040280000002400000014000000f2cc22d6e1ae559b4b11e69260ccab003b000000000000000400000000000000"
    ),
    bytes.fromhex(
        "3b00000001000000f1791554c8b340bad17558190a4efa0023000000f1510100010000000000000013000000010000000b000000"
        "0000000001000d8d777f38004f00000001000000f2cc22d6e1ae559b4b11e69260ccab0037000000f25101000f00000000000000"
        "070000006f706171756500001b00000001000000130000000000000001000d000500000064617461000000002200000001000000"
        "f2cc22d6e1ae559b4b11e69260ccabf1791554c8b340bad17558190a4efa"
    ),
)
"""TypeInformation and TypeMapping of ``struct opaque { octet data; }``: what cyclonedds.idl makes of it."""


class _Idl:
    """What `ddspy_topic_create` asks a data type's `__idl__` for (docs/internals/protocol.md 11.1)."""

    def __init__(self, dds_type: str) -> None:
        self.idl_transformed_typename = dds_type
        self.data_type_props = 0
        self.supported_versions = 1
        self._xt_bytedata = OPAQUE


class _DataType:
    def __init__(self, dds_type: str) -> None:
        self.__idl__ = _Idl(dds_type)


class TypeObjects:
    """The type objects of one domain."""

    _kept: ClassVar[dict[str, _DataType]] = {}
    """For ever: Cyclone drops its references in threads of its own."""
    _silent: ClassVar[dict[int, ct.Array[ct.c_void_p]]] = {}
    """Tables of functions without those that tell, by the address of the table they were copied from. For ever."""

    def __init__(self, api: Api, prepare: Callable[[int, str], None]) -> None:
        """`prepare` is called with each new type object and its type's name."""
        self._api = api
        self._prepare = prepare
        self._lock = threading.Lock()
        self._known: dict[str, int] = {}

    def create_topic(self, create: Callable[..., int], participant: int, topic: str, dds_type: str) -> int:
        """A new topic entity.

        Args:
            create: `ddspy_topic_create`, for the first topic of a type.
        """
        if len(dds_type) > _LONGEST_TYPE:
            raise TransportError(
                f"the DDS name of a type may have {_LONGEST_TYPE} characters, found {len(dds_type)}: {dds_type[:60]}..."
            )
        api = self._api
        what = f"create topic {topic} ({dds_type})"
        with self._lock:
            known = self._known.get(dds_type)
            if known is not None:
                used_up = ct.c_void_p(api.sertype_ref(known))
                return api.check(
                    api.create_topic_sertype(participant, topic.encode(), ct.byref(used_up), None, None, None), what
                )
            data_type = self._kept.setdefault(dds_type, _DataType(dds_type))
            entity = api.check(create(participant, topic, data_type, None, None), what)
            found = ct.c_void_p()
            api.check(api.get_entity_sertype(entity, ct.byref(found)), f"find the type of {topic}")
            assert found.value is not None
            self._known[dds_type] = api.sertype_ref(found.value)
            self._silence(found.value)
            self._prepare(found.value, dds_type)
            return entity

    def __getitem__(self, dds_type: str) -> int:
        """The address of the type object of a type that has topics."""
        return self._known[dds_type]

    def _silence(self, sertype: int) -> None:
        """Take away what tells others about the type. A layout that is not the known one is left alone."""
        place = ct.c_void_p.from_address(sertype)
        original = place.value
        assert original is not None
        table = self._silent.get(original)
        if table is None:
            table = (ct.c_void_p * _OPS_WORDS).from_buffer_copy(ct.string_at(original, 8 * _OPS_WORDS))
            if ct.sizeof(ct.c_void_p) != 8 or table[0] != self._api.sertype_version:
                return
            for index in _TELLING:
                table[index] = None
            self._silent[original] = table
        place.value = ct.addressof(table)

    def close(self) -> None:
        """Give the type objects back, before the domain is deleted."""
        with self._lock:
            for sertype in self._known.values():
                self._api.sertype_unref(sertype)
            self._known.clear()
