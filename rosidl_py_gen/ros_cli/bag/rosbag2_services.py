"""Servers of the services of rosbag2's player and recorder; the package rosbag2_interfaces need not be installed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen import compile_definition

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping

    from rosidl_py_gen.runtime import Node

_DEFINITIONS = {
    "burst": "uint64 num_messages\n---\nuint64 actually_burst\n",
    "get_rate": "---\nfloat64 rate\n",
    "is_paused": "---\nbool paused\n",
    "play": "builtin_interfaces/Time start_offset\nbuiltin_interfaces/Duration playback_duration\n"
    "builtin_interfaces/Time playback_until_timestamp\n---\nbool success\n",
    "play_next": "---\nbool success\n",
    "seek": "builtin_interfaces/Time time\n---\nbool success\n",
    "set_rate": "float64 rate\n---\nbool success\n",
    "snapshot": "---\nbool success\n",
}
"""Definition texts of the services of rosbag2 that have fields, by the name of the service without its prefix."""


def serve_rosbag2(
    node: Node,
    prefix: str,
    handlers: Mapping[str, Callable[[Any], dict[str, Any] | None]],
    before: Callable[[str], Awaitable[object]] | None = None,
) -> None:
    """Serve services of rosbag2's player or recorder on a node, until the node is closed.

    Args:
        prefix: beginning of the service names, such as ``~/``.
        handlers: functions by service name without the prefix; each is called with the request and returns the fields
            of the response as a dict, or None if there are none.
        before: coroutine function that is awaited with the service name before the handler is called.
    """

    def create(name: str, handler: Callable[[Any], dict[str, Any] | None]) -> None:
        kind = name.title().replace("_", "")
        cls: Any = compile_definition(f"rosbag2_interfaces/srv/{kind}", _DEFINITIONS.get(name, "---\n"))

        async def handle(request: Any) -> Any:
            if before is not None:
                await before(name)
            return cls.Response(**(handler(request) or {}))

        node.create_service(cls, f"{prefix}{name}", handle)

    for name, handler in handlers.items():
        create(name, handler)
