"""Text of QoS profiles in liveliness tokens.

Each profile has one text: numbers that equal the default of rmw_zenoh_cpp are omitted, so that all implementations
write the same token and get the same GID. Endpoints decide what a profile means to Zenoh.

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
"""Meaning of depth 0 in rmw_zenoh_cpp, also with KEEP_ALL."""

_FOREVER_S, _FOREVER_NS = sec_nanosec(INFINITE_NS)
_DEFAULTS = (
    *(int(Reliability.RELIABLE), int(Durability.VOLATILE), int(History.KEEP_LAST), DEFAULT_DEPTH),
    *(_FOREVER_S, _FOREVER_NS, _FOREVER_S, _FOREVER_NS, int(Liveliness.AUTOMATIC), _FOREVER_S, _FOREVER_NS),
)
_FIELD_SIZES = (1, 1, 2, 2, 2, 3)
"""Number of numbers in each field between colons."""
_PERIODS = (4, 5, 6, 7, 9, 10)
"""Indexes of seconds and nanoseconds."""
_NUMBER = re.compile(r"[0-9]{0,20}\Z")  # as many digits as the greatest size_t of C++ has


def qos_text(qos: QoSProfile) -> str:
    """Return the text, ``::,10:,:,:,,`` for the default profile; raise `InvalidQoSError` for UNKNOWN policies."""
    policies = (qos.reliability, qos.durability, qos.history, qos.liveliness)
    for policy in policies:
        if policy.name == "UNKNOWN":
            raise InvalidQoSError(f"{type(policy).__name__}.UNKNOWN cannot be announced; only peers have it")
    deadline, lifespan, lease = (
        sec_nanosec(period or INFINITE_NS) for period in (qos.deadline_ns, qos.lifespan_ns, qos.liveliness_lease_ns)
    )
    # SYSTEM_DEFAULT is 0 in every policy, and 0 means the default of rmw_zenoh_cpp.
    numbers = (
        *(int(qos.reliability), int(qos.durability), int(qos.history), qos.depth),
        *(*deadline, *lifespan, int(qos.liveliness), *lease),
    )
    texts = iter(
        "" if number == default or (number == 0 and index not in _PERIODS) else str(number)
        for index, (number, default) in enumerate(zip(numbers, _DEFAULTS, strict=True))
    )
    return ":".join(",".join(itertools.islice(texts, size)) for size in _FIELD_SIZES)


def read_qos(text: str) -> QoSProfile | None:
    """Parse the profile of a token; return None if rmw_zenoh_cpp would reject it.

    A depth that is too large becomes the maximum, a period that is too long becomes infinite. Further numbers are
    ignored.
    """
    fields = [part.split(",")[:size] for part, size in zip(text.split(":"), _FIELD_SIZES, strict=False)]
    texts = [text for part in fields for text in part]
    if [len(part) for part in fields] != list(_FIELD_SIZES) or not all(map(_NUMBER.match, texts)):
        return None
    numbers = [int(text) if text else default for text, default in zip(texts, _DEFAULTS, strict=True)]
    deadline, lifespan, lease = (
        min(numbers[index] * NS_PER_S + numbers[index + 1], INFINITE_NS) for index in (4, 6, 9)
    )
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
    except ValueError:  # an undefined policy
        return None
