"""The services of rosbag2's player: ``/rosbag2_player/pause`` and others, of rosbag2_interfaces.

Decides nothing: they do what the keys do, and more. The definitions are those of the package, which need not be
installed here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen import compile_definition
from rosidl_py_gen.base.stamps import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.ros_cli.playback.player import Player
    from rosidl_py_gen.runtime import Node

PLAYER = "/rosbag2_player"
_PACKAGE = "rosbag2_interfaces"
_NOTHING = "---\n"
_LATER = "Burst", "PlayNext", "Seek"
"""These wait until playing has begun, which they are about."""
_DEFINITIONS = {
    "Burst": "uint64 num_messages\n---\nuint64 actually_burst\n",
    "GetRate": "---\nfloat64 rate\n",
    "IsPaused": "---\nbool paused\n",
    "Pause": _NOTHING,
    "Play": "builtin_interfaces/Time start_offset\nbuiltin_interfaces/Duration playback_duration\n"
    "builtin_interfaces/Time playback_until_timestamp\n---\nbool success\n",
    "PlayNext": "---\nbool success\n",
    "Resume": _NOTHING,
    "Seek": "builtin_interfaces/Time time\n---\nbool success\n",
    "SetRate": "float64 rate\n---\nbool success\n",
    "Stop": _NOTHING,
    "TogglePaused": _NOTHING,
}


def serve(node: Node, player: Player) -> None:
    """Offer the services of a player, as long as the node is there."""

    def add(name: str, kind: str, answer: Callable[[Any], dict[str, Any] | None]) -> None:
        cls: Any = compile_definition(f"{_PACKAGE}/srv/{kind}", _DEFINITIONS[kind])

        async def handle(request: Any) -> Any:
            if kind in _LATER:
                await player.begun()
            return cls.Response(**(answer(request) or {}))

        node.create_service(cls, f"{PLAYER}/{name}", handle)

    timeline = player.timeline
    add("pause", "Pause", lambda _: timeline.pause())
    add("resume", "Resume", lambda _: timeline.resume())
    add("toggle_paused", "TogglePaused", lambda _: player.toggle())
    add("is_paused", "IsPaused", lambda _: {"paused": timeline.is_paused})
    add("get_rate", "GetRate", lambda _: {"rate": timeline.rate})
    add("set_rate", "SetRate", lambda request: {"success": timeline.set_rate(request.rate)})
    add("play", "Play", lambda _: {"success": False})  # it is playing already
    add("play_next", "PlayNext", lambda _: {"success": player.step()})
    add("burst", "Burst", lambda request: {"actually_burst": player.burst(request.num_messages)})
    add("seek", "Seek", lambda request: {"success": player.seek(_ns(request.time))})
    add("stop", "Stop", lambda _: player.stop())


def _ns(stamp: Any) -> int:
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)
