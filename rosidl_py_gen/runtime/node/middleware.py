"""Which transport a context gets: the one it is given, the one that RMW_IMPLEMENTATION means, or the one installed.

Transports are imported here and nowhere else above them, when they are needed: a machine has to have one only.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

from rosidl_py_gen.names import did_you_mean
from rosidl_py_gen.runtime.logs.loggers import get_root_logger
from rosidl_py_gen.runtime.node.environment import EnvironmentSettingError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosidl_py_gen.runtime.transport.interface import Transport

DDS, ZENOH = "dds", "zenoh"
_MEANT = {
    "rmw_connextdds": DDS,
    "rmw_cyclonedds_cpp": DDS,
    "rmw_fastrtps_cpp": DDS,
    "rmw_fastrtps_dynamic_cpp": DDS,
    "rmw_zenoh_cpp": ZENOH,
}
"""All that speak DDS understand each other, so any of them means DDS."""


def chosen_transport(transport: Transport | str | None, environ: Mapping[str, str]) -> Transport:
    """The transport of a new context.

    Args:
        transport: an object, ``"dds"``, ``"zenoh"``, or None: the environment decides.

    Raises:
        TypeError: it is neither. EnvironmentSettingError: no transport has that name. BackendMissingError.
    """
    if transport is None:
        return _made(_by_environment(environ))
    if isinstance(transport, str):
        if transport not in (DDS, ZENOH):
            hint = did_you_mean(transport, [DDS, ZENOH])
            raise EnvironmentSettingError(f"transport must be 'dds' or 'zenoh', got {transport!r:.100}{hint}")
        return _made(transport)
    if isinstance(transport, type) or not callable(getattr(transport, "open", None)):
        raise TypeError(
            f"transport must be 'dds', 'zenoh' or a transport object such as MemoryTransport(), got {transport!r:.100}"
        )
    return transport


def _by_environment(environ: Mapping[str, str]) -> str:
    wanted = environ.get("RMW_IMPLEMENTATION", "")
    if wanted in _MEANT:
        return _MEANT[wanted]
    if wanted:
        get_root_logger().warning(
            f"RMW_IMPLEMENTATION={wanted!r:.100} is not known and has no effect; known are {', '.join(_MEANT)}"
        )
    return ZENOH if find_spec("cyclonedds") is None and find_spec("zenoh") is not None else DDS


def _made(name: str) -> Transport:
    if name == ZENOH:
        from rosidl_py_gen.runtime.transport.zenoh.transport import ZenohTransport

        return ZenohTransport()
    from rosidl_py_gen.runtime.transport.cyclone.participant import CycloneTransport

    return CycloneTransport()
