"""The quality of service that topic commands use.

Decides what a subscription asks for when the user says nothing: what all publishers offer, so that it connects to each
of them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.runtime import Durability, History, Liveliness, QoSProfile, Reliability
from rosidl_py_gen.runtime import qos as presets

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.runtime import TopicEndpointInfo

_POLICIES = {"history": History, "reliability": Reliability, "durability": Durability, "liveliness": Liveliness}
_PRESETS = {"action_status_default": "ACTION_STATUS", "rosout_default": "ROSOUT"}
_ECHO_DEPTH = 100
"""More than the 5 of sensor data: printing is slower than receiving, and bursts shall not be cut."""


def given(qos: dict[str, Any], default: QoSProfile) -> QoSProfile | None:
    """The profile that the ``--qos-...`` options say; None when there are none.

    Args:
        default: what is not said.

    Raises:
        InvalidQoSError: what is said cannot be.
    """
    said = {name: value for name, value in qos.items() if value is not None}
    if not said:
        return None
    profile: QoSProfile = default
    if (preset := said.pop("preset", None)) is not None:
        profile = getattr(presets, _PRESETS.get(preset, preset.upper()))
    lease_s = said.pop("liveliness_lease_s", None)
    for name, kind in _POLICIES.items():
        if name in said:
            said[name] = kind[said[name].upper()]
    profile = replace(profile, **said)
    if profile.durability is Durability.TRANSIENT_LOCAL and profile.depth == 0:
        profile = replace(profile, depth=1)
    if lease_s is not None:
        lease_ns = QoSProfile().automatic_liveliness(lease_s).liveliness_lease_ns
        profile = replace(profile, liveliness_lease_ns=lease_ns)
    return profile


def chosen(publishers: Sequence[TopicEndpointInfo]) -> tuple[QoSProfile, list[str]]:
    """The profile of a subscription that connects to all of these publishers, and what the user should know of it."""
    profile = presets.SENSOR_DATA.keep_last(_ECHO_DEPTH)
    notes = []
    reliable = [one.qos_profile.reliability is Reliability.RELIABLE for one in publishers]
    durable = [one.qos_profile.durability is Durability.TRANSIENT_LOCAL for one in publishers]
    if publishers and all(reliable):
        profile = profile.reliable()
    elif any(reliable):
        notes.append("some, but not all, publishers are reliable: receiving best effort, which connects to all of them")
    if publishers and all(durable):
        profile = profile.transient_local()
    elif any(durable):
        notes.append("some, but not all, publishers are transient local: receiving volatile, so nothing of before now")
    return profile, notes


def is_too_much(profile: QoSProfile, publishers: Sequence[TopicEndpointInfo]) -> bool:
    """Whether a chosen profile asks for more than one of the publishers offers by now."""
    if not publishers:
        return False
    now, _ = chosen(publishers)
    return (profile.reliability is Reliability.RELIABLE is not now.reliability) or (
        profile.durability is Durability.TRANSIENT_LOCAL is not now.durability
    )
