"""ROS QoS profiles as Cyclone QoS objects, and back.

Decides what DDS gets (docs/internals/protocol.md 7.3) and what discovery shows (docs/internals/protocol.md 6.4).
Everything else keeps the DDS default.
"""

from __future__ import annotations

import ctypes as ct
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.cyclone.functions import INFINITE
from rosidl_py_gen.runtime.transport.qos import INFINITE_NS, Durability, History, Liveliness, QoSProfile, Reliability

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.runtime.transport.cyclone.functions import Api

_KEEP_LAST, _KEEP_ALL = 0, 1
_VOLATILE, _TRANSIENT_LOCAL = 0, 1
_BEST_EFFORT, _RELIABLE = 0, 1
_AUTOMATIC, _MANUAL_BY_TOPIC = 0, 2
_UNLIMITED = -1
_XCDR1 = (ct.c_int16 * 1)(0)

_MAX_BLOCKING_NS = 0
"""A write that would block returns at once instead: `endpoints/publisher.py` waits elsewhere, the event loop never
does.

rmw_cyclonedds says infinite here; the value takes no part in matching (docs/internals/protocol.md 7.3).
"""


@contextmanager
def participant_qos(api: Api, user_data: bytes) -> Iterator[int]:
    """QoS of a participant with that USER_DATA."""
    qos = api.create_qos()
    try:
        api.qset_userdata(qos, user_data, len(user_data))
        yield qos
    finally:
        api.delete_qos(qos)


@contextmanager
def endpoint_qos(
    api: Api, profile: QoSProfile, user_data: bytes, *, is_writer: bool, ignore_local: bool = False
) -> Iterator[int]:
    """QoS of a writer or reader; `profile` went through `qos.effective`."""
    qos = api.create_qos()
    try:
        _set_common(api, qos, profile)
        if is_writer:
            api.qset_writer_data_lifecycle(qos, False)
            if profile.lifespan_ns != INFINITE_NS:
                api.qset_lifespan(qos, profile.lifespan_ns)
        if api.qset_psmx_instances is not None:
            api.qset_psmx_instances(qos, 0, None)
        if ignore_local:
            api.qset_ignorelocal(qos, 1)
        if user_data:
            api.qset_userdata(qos, user_data, len(user_data))
        yield qos
    finally:
        api.delete_qos(qos)


def _set_common(api: Api, qos: int, profile: QoSProfile) -> None:
    history = _KEEP_ALL if profile.history is History.KEEP_ALL else _KEEP_LAST
    depth = 1 if history == _KEEP_ALL else profile.depth
    api.qset_history(qos, history, depth)
    reliable = profile.reliability is Reliability.RELIABLE
    api.qset_reliability(qos, _RELIABLE if reliable else _BEST_EFFORT, _MAX_BLOCKING_NS)
    if profile.durability is Durability.TRANSIENT_LOCAL:
        api.qset_durability(qos, _TRANSIENT_LOCAL)
        api.qset_durability_service(qos, 0, history, depth, _UNLIMITED, _UNLIMITED, _UNLIMITED)
    else:
        api.qset_durability(qos, _VOLATILE)
    if profile.deadline_ns != INFINITE_NS:
        api.qset_deadline(qos, profile.deadline_ns)
    manual = profile.liveliness is Liveliness.MANUAL_BY_TOPIC
    api.qset_liveliness(qos, _MANUAL_BY_TOPIC if manual else _AUTOMATIC, profile.liveliness_lease_ns)
    api.qset_data_representation(qos, 1, _XCDR1)


def read_user_data(api: Api, qos: int) -> bytes:
    """USER_DATA of a discovered entity."""
    pointer, size = ct.c_void_p(), ct.c_size_t()
    if not api.qget_userdata(qos, ct.byref(pointer), ct.byref(size)) or not pointer.value:
        return b""
    try:
        return ct.string_at(pointer.value, size.value)
    finally:
        api.free(pointer)


def read_property(api: Api, qos: int, name: bytes) -> str:
    """A property of a discovered participant; empty when it has none of that name."""
    pointer = ct.c_void_p()
    if not api.qget_prop(qos, name, ct.byref(pointer)) or not pointer.value:
        return ""
    try:
        return ct.string_at(pointer.value).decode(errors="replace")
    finally:
        api.free(pointer)


def read_profile(api: Api, qos: int, *, is_writer: bool) -> QoSProfile:
    """The profile of a discovered endpoint; a policy it does not carry has its DDS default."""
    kind, depth, duration = ct.c_int(), ct.c_int32(), ct.c_int64()
    keep_all = bool(api.qget_history(qos, ct.byref(kind), ct.byref(depth))) and kind.value == _KEEP_ALL
    shown_depth = 0 if keep_all else max(1, depth.value)
    reliable = bool(api.qget_reliability(qos, ct.byref(kind), ct.byref(duration))) and kind.value == _RELIABLE
    liveliness, lease_ns = _read_liveliness(api, qos)
    return QoSProfile(
        history=History.KEEP_ALL if keep_all else History.KEEP_LAST,
        depth=shown_depth,
        reliability=Reliability.RELIABLE if reliable else Reliability.BEST_EFFORT,
        durability=_read_durability(api, qos),
        deadline_ns=_duration(api.qget_deadline(qos, ct.byref(duration)), duration),
        lifespan_ns=_duration(is_writer and api.qget_lifespan(qos, ct.byref(duration)), duration),
        liveliness=liveliness,
        liveliness_lease_ns=lease_ns,
    )


def _read_durability(api: Api, qos: int) -> Durability:
    kind = ct.c_int(_VOLATILE)
    api.qget_durability(qos, ct.byref(kind))
    return {_VOLATILE: Durability.VOLATILE, _TRANSIENT_LOCAL: Durability.TRANSIENT_LOCAL}.get(
        kind.value, Durability.UNKNOWN
    )


def _read_liveliness(api: Api, qos: int) -> tuple[Liveliness, int]:
    kind, lease = ct.c_int(_AUTOMATIC), ct.c_int64(INFINITE)
    present = api.qget_liveliness(qos, ct.byref(kind), ct.byref(lease))
    known = {_AUTOMATIC: Liveliness.AUTOMATIC, _MANUAL_BY_TOPIC: Liveliness.MANUAL_BY_TOPIC}
    return known.get(kind.value, Liveliness.UNKNOWN), _duration(present, lease)


def _duration(present: bool, value: ct.c_int64) -> int:
    return value.value if present and value.value != INFINITE else INFINITE_NS
