"""Command group ``rosidl-py topic``: QoS options that its commands share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

import click

from rosidl_py_gen.ros_cli import options

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import QoSProfile

F = TypeVar("F", bound=Callable[..., Any])

_POLICIES = {
    "history": ["system_default", "keep_last", "keep_all"],
    "reliability": ["system_default", "reliable", "best_effort", "best_available"],
    "durability": ["system_default", "transient_local", "volatile", "best_available"],
    "liveliness": ["system_default", "automatic", "manual_by_topic", "best_available"],
}
_PRESETS = {"action_status_default": "ACTION_STATUS", "rosout_default": "ROSOUT"}


def _qos_option(name: str, into: str, **settings: Any) -> Callable[[F], F]:
    def add_value(ctx: click.Context, param: click.Parameter, value: Any) -> None:
        ctx.params.setdefault("qos", {})[into] = value

    return click.option(name, into, expose_value=False, callback=add_value, **settings)


qos_options = options.all_of(
    _qos_option(
        "--qos-profile",
        "preset",
        type=click.Choice(
            [
                *("default", "sensor_data", "system_default", "services_default", "parameters", "parameter_events"),
                *("action_status_default", "rosout_default", "best_available"),
            ]
        ),
        help="Preset that the other options change.",
    ),
    _qos_option("--qos-depth", "depth", type=click.IntRange(0), metavar="N", help="Depth of the queue."),
    *(_qos_option(f"--qos-{name}", name, type=click.Choice(choices)) for name, choices in _POLICIES.items()),
    _qos_option(
        "--qos-liveliness-lease-duration-seconds", "liveliness_lease_s", type=click.FloatRange(0), metavar="SECONDS"
    ),
)
"""QoS options of topic commands, passed as the dict `qos`; the value of an option that is not used is None."""


def requested_profile(qos: dict[str, Any], default: QoSProfile) -> QoSProfile | None:
    """Return the profile that ``--qos-...`` options request, based on `default`; None if no such option is used."""
    from rosidl_py_gen.runtime import Durability, QoSProfile
    from rosidl_py_gen.runtime import qos as presets

    requested = {name: value for name, value in qos.items() if value is not None}
    if not requested:
        return None
    profile: QoSProfile = default
    if (preset := requested.pop("preset", None)) is not None:
        profile = getattr(presets, _PRESETS.get(preset, preset.upper()))
    lease_s = requested.pop("liveliness_lease_s", None)
    for name, kind in presets.ENUMS.items():
        if name in requested:
            requested[name] = kind[requested[name].upper()]
    profile = replace(profile, **requested)
    if profile.durability is Durability.TRANSIENT_LOCAL and profile.depth == 0:
        profile = replace(profile, depth=1)
    if lease_s is not None:
        lease_ns = QoSProfile().automatic_liveliness(lease_s).liveliness_lease_ns
        profile = replace(profile, liveliness_lease_ns=lease_ns)
    return profile
