"""The quality of service that the options of topic commands say."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rosidl_py_gen.runtime import Durability, History, Liveliness, QoSProfile, Reliability
from rosidl_py_gen.runtime import qos as presets

_POLICIES = {"history": History, "reliability": Reliability, "durability": Durability, "liveliness": Liveliness}
_PRESETS = {"action_status_default": "ACTION_STATUS", "rosout_default": "ROSOUT"}


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
