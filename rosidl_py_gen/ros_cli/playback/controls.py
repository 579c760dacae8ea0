"""Services of rosbag2's player, such as ``/rosbag2_player/pause``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.stamps import stamp_ns
from rosidl_py_gen.ros_cli.bag.rosbag2_services import serve_rosbag2

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.playback.player import Player
    from rosidl_py_gen.runtime import Node

PLAYER = "/rosbag2_player"
_NEED_START = ("Burst", "PlayNext", "Seek")


def serve(node: Node, player: Player) -> None:
    """Create the services of a player."""
    timeline = player.timeline

    async def wait_for_start(kind: str) -> None:
        if kind in _NEED_START:
            await player.started()

    serve_rosbag2(
        node,
        f"{PLAYER}/",
        (
            ("pause", "Pause", lambda _: timeline.pause()),
            ("resume", "Resume", lambda _: timeline.resume()),
            ("toggle_paused", "TogglePaused", lambda _: player.toggle()),
            ("is_paused", "IsPaused", lambda _: {"paused": timeline.is_paused}),
            ("get_rate", "GetRate", lambda _: {"rate": timeline.rate}),
            ("set_rate", "SetRate", lambda request: {"success": timeline.set_rate(request.rate)}),
            ("play", "Play", lambda _: {"success": False}),  # it is playing already
            ("play_next", "PlayNext", lambda _: {"success": player.step()}),
            ("burst", "Burst", lambda request: {"actually_burst": player.burst(request.num_messages)}),
            ("seek", "Seek", lambda request: {"success": player.seek(stamp_ns(request.time))}),
            ("stop", "Stop", lambda _: player.stop()),
        ),
        wait_for_start,
    )
