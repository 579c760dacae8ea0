"""Services of rosbag2's player and recorder, of the package rosbag2_interfaces, which need not be installed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen import compile_definition

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Iterable

    from rosidl_py_gen.runtime import Node

_EMPTY = "---\n"
_DEFINITIONS = {
    "Burst": "uint64 num_messages\n---\nuint64 actually_burst\n",
    "GetRate": "---\nfloat64 rate\n",
    "IsPaused": "---\nbool paused\n",
    "Pause": _EMPTY,
    "Play": "builtin_interfaces/Time start_offset\nbuiltin_interfaces/Duration playback_duration\n"
    "builtin_interfaces/Time playback_until_timestamp\n---\nbool success\n",
    "PlayNext": "---\nbool success\n",
    "Resume": _EMPTY,
    "Seek": "builtin_interfaces/Time time\n---\nbool success\n",
    "SetRate": "float64 rate\n---\nbool success\n",
    "Snapshot": "---\nbool success\n",
    "SplitBagfile": _EMPTY,
    "Stop": _EMPTY,
    "TogglePaused": _EMPTY,
}


def serve_rosbag2(
    node: Node,
    prefix: str,
    handlers: Iterable[tuple[str, str, Callable[[Any], dict[str, Any] | None]]],
    before: Callable[[str], Awaitable[object]] | None = None,
) -> None:
    """Create services until the node is closed.

    Args:
        prefix: of the names of services.
        handlers: name, type and function of each; a function returns the fields of the response.
        before: awaited with the type of a service before its function is called.
    """

    def create(name: str, kind: str, handler: Callable[[Any], dict[str, Any] | None]) -> None:
        cls: Any = compile_definition(f"rosbag2_interfaces/srv/{kind}", _DEFINITIONS[kind])

        async def handle(request: Any) -> Any:
            if before is not None:
                await before(kind)
            return cls.Response(**(handler(request) or {}))

        node.create_service(cls, f"{prefix}{name}", handle)

    for name, kind, handler in handlers:
        create(name, kind, handler)
