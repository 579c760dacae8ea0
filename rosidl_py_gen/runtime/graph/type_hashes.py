"""Comparison of type hashes, and the setting for messages whose sender has another definition of the type.

Endpoints announce the RIHS01 hash of their type. A hash that is not announced, or not known here, is not a difference.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, get_args

from rosidl_py_gen.base.distributions import DEFAULT
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint

TypeCheck = Literal["error", "warn", "off"]
"""Treatment of messages whose sender has another definition.

``error`` drops them. ``warn`` delivers samples of unknown definitions, and drops samples of another ROS distribution,
whose bytes would be misread. ``off`` delivers all of them without a warning.
"""
DEFAULT_CHECK: TypeCheck = "error"
_KINDS = {"/srv/": "service", "/action/": "action"}


def checked_mode(mode: TypeCheck | None, default: TypeCheck = DEFAULT_CHECK) -> TypeCheck:
    """Return a type hash check mode unchanged, or the default for None; raises `ValueError` for other values."""
    if mode is None:
        return default
    if mode not in get_args(TypeCheck):
        raise ValueError(f'type_hash_check must be "error", "warn" or "off", got {mode!r:.100}')
    return mode


def type_hashes_differ(endpoint: DiscoveredEndpoint, type_hash: str, service_hash: str = "") -> bool:
    """Return True if an endpoint announces a type hash that is not among the given hashes."""
    if endpoint.type_hash and type_hash:
        return endpoint.type_hash != type_hash
    return bool(endpoint.service_hash and service_hash) and endpoint.service_hash != service_hash


def distributions_of(peer: DiscoveredEndpoint, own: DiscoveredEndpoint) -> tuple[str, ...]:
    """Return the distributions that have a peer's definition of a type, if it differs from the own definition.

    The result is empty if none has it.
    """
    from rosidl_py_gen.type_loading.from_description import distributions_with

    try:
        if peer.type_hash and own.type_hash:
            return distributions_with(own.type, own.type_hash, peer.type_hash)
        return distributions_with(own.service_type or "", own.service_hash, peer.service_hash)
    except RosidlError:  # a definition cannot be read
        return ()


def distribution_advice(distros: tuple[str, ...], type_name: str) -> str:
    """Return a text that advises how to use the definition of a type that the given distributions have."""
    distro = DEFAULT if DEFAULT in distros else distros[0]
    kind = next((word for part, word in _KINDS.items() if part in type_name), "message")
    return f'set ROS_DISTRO={distro}, or pass distro="{distro}" to get_{kind}'
