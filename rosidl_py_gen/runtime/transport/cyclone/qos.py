"""Conversion of ROS QoS profiles to Cyclone QoS objects and back.

Policies of DDS that ROS does not have keep the default of DDS. Source: docs/internals/protocol.md 7.3 and 6.4.
"""

from __future__ import annotations

import ctypes as ct
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TypeVar

from rosidl_py_gen.runtime.transport.api import EndpointSpec
from rosidl_py_gen.runtime.transport.cyclone.c_api import CycloneApi
from rosidl_py_gen.runtime.transport.dds.names import endpoint_user_data
from rosidl_py_gen.runtime.transport.qos import INFINITE_NS, Durability, History, Liveliness, QoSProfile, Reliability

_Policy = TypeVar("_Policy", History, Durability, Reliability, Liveliness)
_HISTORY = {History.KEEP_LAST: 0, History.KEEP_ALL: 1}
_DURABILITY = {Durability.VOLATILE: 0, Durability.TRANSIENT_LOCAL: 1}
_RELIABILITY = {Reliability.BEST_EFFORT: 0, Reliability.RELIABLE: 1}
_LIVELINESS = {Liveliness.AUTOMATIC: 0, Liveliness.MANUAL_BY_TOPIC: 2}
"""Numbers of the liveliness kinds in Cyclone; other dicts of this module have the numbers of the other policies."""
_UNLIMITED = -1
_XCDR1 = (ct.c_int16 * 1)(0)

_MAX_BLOCKING_NS = 0
"""Maximum blocking time of a write. 0, because the event loop must not block; `entities/publisher.py` waits instead.

rmw_cyclonedds has infinity; the value does not influence matching (docs/internals/protocol.md 7.3).
"""


@contextmanager
def new_qos(api: CycloneApi, user_data: bytes, properties: Iterable[tuple[bytes, bytes]] = ()) -> Iterator[int]:
    """Yield a Cyclone QoS object with default policies, with `user_data` as USER_DATA, and with `properties` (pairs of
    name and value).
    """
    qos = api.create_qos()
    try:
        if user_data:
            api.qset_userdata(qos, user_data, len(user_data))
        for name, value in properties:
            api.qset_prop(qos, name, value)
        yield qos
    finally:
        api.delete_qos(qos)


@contextmanager
def endpoint_qos(api: CycloneApi, spec: EndpointSpec, *, is_writer: bool) -> Iterator[int]:
    """Yield a Cyclone QoS object for a writer or reader; `spec.qos` must be a result of `effective`."""
    profile, history = spec.qos, _HISTORY[spec.qos.history]
    depth = profile.depth or 1  # 0 with KEEP_ALL, where DDS ignores it
    ids = {"client_id": spec.client_id, "service_id": spec.service_id, "service_hash": spec.service_hash}
    user_data = endpoint_user_data(spec.type_hash, **ids)
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
        if spec.ignore_local:
            api.qset_ignorelocal(qos, 1)
        yield qos


def read_user_data(api: CycloneApi, qos: int) -> bytes:
    """Return the USER_DATA in the QoS object of a discovered entity; empty if there is none."""
    pointer, size = ct.c_void_p(), ct.c_size_t()
    exists = api.qget_userdata(qos, ct.byref(pointer), ct.byref(size))
    return _take_copy(api, pointer, size.value) if exists else b""


def read_property(api: CycloneApi, qos: int, name: bytes) -> str:
    """Return a property from the QoS object of a discovered participant; empty if the property does not exist."""
    pointer = ct.c_void_p()
    exists = api.qget_prop(qos, name, ct.byref(pointer))
    return _take_copy(api, pointer, -1).decode(errors="replace") if exists else ""


def _take_copy(api: CycloneApi, pointer: ct.c_void_p, size: int) -> bytes:
    """Return a copy of bytes that the library has allocated, and free the original.

    With size -1, the bytes end at a NUL.
    """
    try:
        return ct.string_at(pointer, size) if pointer else b""
    finally:
        api.free(pointer)


def read_profile(api: CycloneApi, qos: int, *, is_writer: bool) -> QoSProfile:
    """Return the ROS profile in the QoS object of a discovered endpoint; a missing policy has the default of DDS."""
    kind, depth, lease, period = ct.c_int(), ct.c_int32(), ct.c_int64(INFINITE_NS), ct.c_int64()

    def number_of(policy: str, *others: object) -> int:
        kind.value = 0  # the default of DDS for each policy
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


def _policy(numbers: Mapping[_Policy, int], number: int, default: _Policy) -> _Policy:
    return next((policy for policy, policy_number in numbers.items() if policy_number == number), default)
