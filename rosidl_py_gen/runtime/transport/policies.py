"""The single values of a quality-of-service profile: enumerations with rmw's numbers, and durations.

Decides which values a policy may have; profiles are `qos.py`.
"""

from __future__ import annotations

from enum import IntEnum

from rosidl_py_gen.errors import RosidlError

UNSPECIFIED_NS = 0
INFINITE_NS = 9223372036_854775807
BEST_AVAILABLE_NS = 9223372036_854775806
MAX_DEPTH = 2**31 - 1


class InvalidQoSError(RosidlError, ValueError):
    """The caller asked for a quality of service that cannot exist."""


class History(IntEnum):
    """How many samples are kept; numbers of rmw (protocol.md 7.1)."""

    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2
    UNKNOWN = 3


class Reliability(IntEnum):
    """Whether lost samples are sent again; numbers of rmw."""

    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class Durability(IntEnum):
    """Whether late joiners get earlier samples; numbers of rmw."""

    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class Liveliness(IntEnum):
    """Who says that a publisher is alive; numbers of rmw (2 was removed there)."""

    SYSTEM_DEFAULT = 0
    AUTOMATIC = 1
    MANUAL_BY_TOPIC = 3
    UNKNOWN = 4
    BEST_AVAILABLE = 5


POLICIES: dict[str, type[IntEnum]] = {
    "history": History,
    "reliability": Reliability,
    "durability": Durability,
    "liveliness": Liveliness,
}
"""Field of a profile -> what it may hold."""


def policy_of(name: str, kind: type[IntEnum], value: object) -> IntEnum:
    """The member that a plain int stands for; everything else is refused in words that name a member."""
    numbers = [int(member) for member in kind]
    if value.__class__ is int and value in numbers and kind is not History:
        return kind(value)
    members = ", ".join(f"{kind.__name__}.{member.name}" for member in kind if member.name != "UNKNOWN")
    words = f"{name} must be one of {members}; got {value!r}"
    if value.__class__ is int and kind is History:
        words += f". A keep-last depth is written QoSProfile(depth={value}), or just {value} in place of the profile"
    elif isinstance(value, str) and value.upper() in kind.__members__:
        words += f": write {kind.__name__}.{value.upper()}"
    raise InvalidQoSError(words)


def duration_ns(what: str, seconds: float) -> int:
    """Seconds as a period in ns; raises `InvalidQoSError`."""
    number = isinstance(seconds, (int, float)) and not isinstance(seconds, bool)
    if number and seconds == float("inf"):
        return INFINITE_NS
    if not number or not 0 <= seconds < INFINITE_NS / 1e9:
        raise InvalidQoSError(f"{what} must be seconds, 0 (unspecified) or more, or math.inf; got {seconds!r}")
    return round(seconds * 1_000_000_000)
