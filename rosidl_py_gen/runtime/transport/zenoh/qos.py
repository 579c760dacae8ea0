"""QoS profiles as liveliness tokens write them.

Decides one text for each profile: a number that is the default of rmw_zenoh_cpp is left empty, so that two who write
the same profile get the same token and the same GID. Nothing is enforced by it; what a profile does to Zenoh's
publishers and subscribers is the endpoints' business.

Source: docs/internals/zenoh.md 3.4 to 3.6 (rmw_zenoh_cpp, liveliness_utils.cpp and qos.cpp).
"""

from __future__ import annotations

import itertools
import re

from rosidl_py_gen.base.stamps import NS_PER_S, sec_nanosec
from rosidl_py_gen.runtime.transport.qos import (
    INFINITE_NS,
    MAX_DEPTH,
    Durability,
    History,
    InvalidQoSError,
    Liveliness,
    QoSProfile,
    Reliability,
)

DEFAULT_DEPTH = 42
"""What a depth of 0 means to rmw_zenoh_cpp, with KEEP_ALL too."""

_FOREVER_S, _FOREVER_NS = sec_nanosec(INFINITE_NS)
_DEFAULTS = (
    *(int(Reliability.RELIABLE), int(Durability.VOLATILE), int(History.KEEP_LAST), DEFAULT_DEPTH),
    *(_FOREVER_S, _FOREVER_NS, _FOREVER_S, _FOREVER_NS, int(Liveliness.AUTOMATIC), _FOREVER_S, _FOREVER_NS),
)
_PARTS = (1, 1, 2, 2, 2, 3)
"""How many numbers each part between colons has."""
_PERIODS = (4, 5, 6, 7, 9, 10)
"""Places of seconds and nanoseconds."""
_NUMBER = re.compile(r"[0-9]{0,20}\Z")  # as many digits as the greatest size_t of C++ has


def qos_text(qos: QoSProfile) -> str:
    """For example ``::,10:,:,:,,`` for the default profile; raises `InvalidQoSError` for UNKNOWN policies."""
    policies = (qos.reliability, qos.durability, qos.history, qos.liveliness)
    for policy in policies:
        if policy.name == "UNKNOWN":
            raise InvalidQoSError(f"{type(policy).__name__}.UNKNOWN cannot be announced: only others have that")
    deadline, lifespan, lease = (
        sec_nanosec(period or INFINITE_NS) for period in (qos.deadline_ns, qos.lifespan_ns, qos.liveliness_lease_ns)
    )
    # SYSTEM_DEFAULT is 0 in every policy, and 0 means the default of rmw_zenoh_cpp.
    numbers = (
        *(int(qos.reliability), int(qos.durability), int(qos.history), qos.depth),
        *(*deadline, *lifespan, int(qos.liveliness), *lease),
    )
    written = iter(
        "" if number == default or (number == 0 and place not in _PERIODS) else str(number)
        for place, (number, default) in enumerate(zip(numbers, _DEFAULTS, strict=True))
    )
    return ":".join(",".join(itertools.islice(written, size)) for size in _PARTS)


def read_qos(text: str) -> QoSProfile | None:
    """The profile of a token; None when rmw_zenoh_cpp would not take it.

    A depth beyond what a profile can hold becomes the greatest, a period beyond it becomes infinite. Numbers behind
    those that are known are left alone.
    """
    parts = [part.split(",")[:size] for part, size in zip(text.split(":"), _PARTS, strict=False)]
    written = [number for part in parts for number in part]
    if [len(part) for part in parts] != list(_PARTS) or not all(map(_NUMBER.match, written)):
        return None
    numbers = [int(number) if number else default for number, default in zip(written, _DEFAULTS, strict=True)]
    deadline, lifespan, lease = (min(numbers[at] * NS_PER_S + numbers[at + 1], INFINITE_NS) for at in (4, 6, 9))
    try:
        return QoSProfile(
            history=History(numbers[2]),
            depth=min(numbers[3], MAX_DEPTH) or DEFAULT_DEPTH,
            reliability=Reliability(numbers[0]),
            durability=Durability(numbers[1]),
            deadline_ns=deadline,
            lifespan_ns=lifespan,
            liveliness=Liveliness(numbers[8]),
            liveliness_lease_ns=lease,
        )
    except ValueError:  # no such policy
        return None
