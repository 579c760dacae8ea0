"""ROS QoS profiles as Cyclone QoS objects, and back.

Decides what DDS gets (docs/internals/protocol.md 7.3) and what discovery shows (docs/internals/protocol.md 6.4).
Everything else keeps the DDS default.
"""

from __future__ import annotations

import ctypes as ct
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

from rosidl_py_gen.runtime.transport.dds.names import endpoint_user_data
from rosidl_py_gen.runtime.transport.qos import INFINITE_NS, Durability, History, Liveliness, QoSProfile, Reliability

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rosidl_py_gen.runtime.transport.cyclone.c_api import CycloneApi
    from rosidl_py_gen.runtime.transport.dds.participant import DdsEndpoint

_Policy = TypeVar("_Policy", History, Durability, Reliability, Liveliness)
_HISTORY = {History.KEEP_LAST: 0, History.KEEP_ALL: 1}
_DURABILITY = {Durability.VOLATILE: 0, Durability.TRANSIENT_LOCAL: 1}
_RELIABILITY = {Reliability.BEST_EFFORT: 0, Reliability.RELIABLE: 1}
_LIVELINESS = {Liveliness.AUTOMATIC: 0, Liveliness.MANUAL_BY_TOPIC: 2}
"""What stands for a policy in DDS."""
_UNLIMITED = -1
_XCDR1 = (ct.c_int16 * 1)(0)

_MAX_BLOCKING_NS = 0
"""A write that would block returns at once instead: `entities/publisher.py` waits elsewhere, the event loop never
does.

rmw_cyclonedds says infinite here; the value takes no part in matching (docs/internals/protocol.md 7.3).
"""


@contextmanager
def new_qos(api: CycloneApi, user_data: bytes) -> Iterator[int]:
    """QoS with that USER_DATA, all else as DDS has it: that of a participant."""
    qos = api.create_qos()
    try:
        if user_data:
            api.qset_userdata(qos, user_data, len(user_data))
        yield qos
    finally:
        api.delete_qos(qos)


@contextmanager
def endpoint_qos(api: CycloneApi, end: DdsEndpoint, *, is_writer: bool) -> Iterator[int]:
    """QoS of a writer or reader, whose profile went through `qos.effective`."""
    profile, history = end.qos, _HISTORY[end.qos.history]
    depth = profile.depth or 1  # of all that is kept
    user_data = endpoint_user_data(end.type_hash, client_id=end.client_id, service_id=end.service_id)
    with new_qos(api, user_data) as qos:
        api.qset_history(qos, history, depth)
        api.qset_reliability(qos, _RELIABILITY[profile.reliability], _MAX_BLOCKING_NS)
        api.qset_durability(qos, _DURABILITY[profile.durability])
        if profile.durability is Durability.TRANSIENT_LOCAL:
            api.qset_durability_service(qos, 0, history, depth, _UNLIMITED, _UNLIMITED, _UNLIMITED)
        if profile.deadline_ns != INFINITE_NS:
            api.qset_deadline(qos, profile.deadline_ns)
        api.qset_liveliness(qos, _LIVELINESS[profile.liveliness], profile.liveliness_lease_ns)
        api.qset_data_representation(qos, 1, _XCDR1)
        if is_writer:
            api.qset_writer_data_lifecycle(qos, False)
            if profile.lifespan_ns != INFINITE_NS:
                api.qset_lifespan(qos, profile.lifespan_ns)
        if api.qset_psmx_instances is not None:
            api.qset_psmx_instances(qos, 0, None)
        if end.ignore_local:
            api.qset_ignorelocal(qos, 1)
        yield qos


def read_user_data(api: CycloneApi, qos: int) -> bytes:
    """USER_DATA of a discovered entity."""
    pointer, size = ct.c_void_p(), ct.c_size_t()
    is_there = api.qget_userdata(qos, ct.byref(pointer), ct.byref(size))
    return _taken(api, pointer, size.value) if is_there else b""


def read_property(api: CycloneApi, qos: int, name: bytes) -> str:
    """A property of a discovered participant; empty when it has none of that name."""
    pointer = ct.c_void_p()
    is_there = api.qget_prop(qos, name, ct.byref(pointer))
    return _taken(api, pointer, -1).decode(errors="replace") if is_there else ""


def _taken(api: CycloneApi, pointer: ct.c_void_p, size: int) -> bytes:
    """The bytes of a copy that the library made for us, which is freed; -1 means that they end with a NUL."""
    try:
        return ct.string_at(pointer, size) if pointer else b""
    finally:
        api.free(pointer)


def read_profile(api: CycloneApi, qos: int, *, is_writer: bool) -> QoSProfile:
    """The profile of a discovered endpoint; a policy it does not carry has its DDS default."""
    kind, depth, lease, period = ct.c_int(), ct.c_int32(), ct.c_int64(INFINITE_NS), ct.c_int64()

    def number_of(policy: str, *others: object) -> int:
        kind.value = 0  # the default of DDS, for each
        getattr(api, f"qget_{policy}")(qos, ct.byref(kind), *others)
        return kind.value

    def period_of(policy: str) -> int:
        period.value = INFINITE_NS
        getattr(api, f"qget_{policy}")(qos, ct.byref(period))
        return period.value

    history = _policy(_HISTORY, number_of("history", ct.byref(depth)), History.KEEP_LAST)
    return QoSProfile(
        history=history,
        depth=0 if history is History.KEEP_ALL else max(1, depth.value),
        reliability=_policy(_RELIABILITY, number_of("reliability", ct.byref(period)), Reliability.BEST_EFFORT),
        durability=_policy(_DURABILITY, number_of("durability"), Durability.UNKNOWN),
        deadline_ns=period_of("deadline"),
        lifespan_ns=period_of("lifespan") if is_writer else INFINITE_NS,
        liveliness=_policy(_LIVELINESS, number_of("liveliness", ct.byref(lease)), Liveliness.UNKNOWN),
        liveliness_lease_ns=lease.value,
    )


def _policy(numbers: Mapping[_Policy, int], number: int, other: _Policy) -> _Policy:
    return next((policy for policy, own in numbers.items() if own == number), other)
