"""Whether two endpoints speak of one type by two definitions, and what an endpoint does about it.

Known from the RIHS01 hashes that endpoints announce. Decides that a hash that is not announced, or not known here, is
no reason for anything.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint

TypeCheck = Literal["error", "warn", "off"]
"""What becomes of messages whose sender announces another definition: withheld, handed out with a warning, or handed
out in silence."""
_MODES = "error", "warn", "off"


def checked_mode(mode: TypeCheck | None, default: TypeCheck = "error") -> TypeCheck:
    """The mode, or the default for None; raises `ValueError` for others."""
    if mode is None:
        return default
    if mode not in _MODES:
        raise ValueError(f'type_check must be "error", "warn" or "off", got {mode!r:.100}')
    return mode


def type_hashes_differ(endpoint: DiscoveredEndpoint, type_hash: str, service_hash: str = "") -> bool:
    """Whether an endpoint announces another hash than these; what is not announced, or not known here, is no reason."""
    if endpoint.type_hash and type_hash:
        return endpoint.type_hash != type_hash
    return bool(endpoint.service_hash and service_hash) and endpoint.service_hash != service_hash
