"""``bag play``: a run from options to the final report."""

from __future__ import annotations

import asyncio
from contextlib import nullcontext
from typing import TYPE_CHECKING

from rosidl_py_gen.base.stamps import stamp_ns
from rosidl_py_gen.ros_cli import DAMAGED, AsyncCommand, CommandError, terminal_output
from rosidl_py_gen.ros_cli.bag.qos_overrides import read_qos_overrides
from rosidl_py_gen.ros_cli.bag.rosbag2_services import serve_rosbag2
from rosidl_py_gen.ros_cli.command_node import CommandNode, NetworkOptions, first_of
from rosidl_py_gen.ros_cli.keyboard import read_keys
from rosidl_py_gen.ros_cli.playback.player import Player
from rosidl_py_gen.ros_cli.playback.recording import Recording, select_messages, selected_topics
from rosidl_py_gen.ros_cli.playback.senders import cannot_play_reason

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rosidl_py_gen.ros_cli.bag.selection import BagSelection
    from rosidl_py_gen.ros_cli.playback.command import PlayOptions
    from rosidl_py_gen.runtime import Node, QoSProfile

_SUBSCRIBER_DISCOVERY_S = 2.0
"""Time for discovering subscribers; Fast DDS takes up to a second longer (docs/internals/dds.md 6)."""
_RATE_STEP = 0.1
_PLAYER = "/rosbag2_player"
_NEED_START = ("Burst", "PlayNext", "Seek")


def play_bag(network: NetworkOptions, options: PlayOptions) -> AsyncCommand:
    """Return the command for the options. Raises as `read_qos_overrides`."""
    overrides = read_qos_overrides(options.qos_file)
    return AsyncCommand(_open(network, options, overrides), endless=options.loop)


async def _open(network: NetworkOptions, options: PlayOptions, overrides: Mapping[str, QoSProfile]) -> int:
    with Recording(options.bags, options.paths, options.storage) as recording:
        topics = _playable_topics(recording, selected_topics(recording, options))
        part = select_messages(recording, topics, options)
        await _play(network, recording, part, options, overrides)
        return DAMAGED if recording.is_damaged else 0


def _playable_topics(recording: Recording, topics: Sequence[str]) -> list[str]:
    """Return the topics without those whose name or type is invalid in ROS 2. Raises `CommandError`."""
    left = {}
    for _, channel in recording.channels:
        if channel.name not in topics:
            continue
        if reason := cannot_play_reason(channel):
            terminal_output.note(f"{channel.name} [{channel.type_name}] is skipped: {reason}")
        else:
            left[channel.name] = True
    if topics and not left:
        raise CommandError(f"{recording.name}: none of its topics can be played")
    return [name for name in topics if name in left]


async def _play(
    network: NetworkOptions,
    recording: Recording,
    part: BagSelection,
    options: PlayOptions,
    overrides: Mapping[str, QoSProfile],
) -> None:
    node_options = {"start_type_description_service": True}  # peers may not have the types
    async with CommandNode(network, parameter_overrides=node_options) as command_node:
        player = Player(command_node, recording, part, options, overrides)
        _serve(command_node.node, player)
        await command_node.wait_for_discovery()
        if network.get("spin_time_s") is None:
            await asyncio.gather(
                player.publishers.wait_for_subscribers(_SUBSCRIBER_DISCOVERY_S),
                player.requests.wait_for_servers(_SUBSCRIBER_DISCOVERY_S),
            )
        await asyncio.sleep(options.delay_s)
        await _play_with_keys(player, options)
        await asyncio.gather(
            player.publishers.wait_acknowledged(options.acked_ms), player.requests.wait_for_responses()
        )
        sent = player.requests.count
        requests_text = f" and sent {sent} requests" if options.publish_requests or options.actions_as_client else ""
        terminal_output.note(f"published {player.count - sent} messages of {len(part.topics)} topics{requests_text}")


async def _play_with_keys(player: Player, options: PlayOptions) -> None:
    actions: dict[str, Callable[[], object]] = {
        "space": player.toggle,
        "right": player.step,
        "up": lambda: player.change_rate(_RATE_STEP),
        "down": lambda: player.change_rate(-_RATE_STEP),
    }
    keys = nullcontext(False) if options.no_keys else read_keys(actions)
    with keys as has_keys, terminal_output.StatusLine() as status:
        usage = "space: pause, →: next message, ↑↓: rate; Ctrl-C ends playback" if has_keys else "Ctrl-C ends playback"
        if has_keys and not status.is_possible:
            terminal_output.note(usage)
        if options.start_paused and not has_keys:
            terminal_output.note(f"paused, until the service {_PLAYER}/resume is called")

        def show_state() -> None:
            status.show(f"{player.state()}; {usage}")

        helpers = [player.publish_clock(options.clock_hz)] if options.clock_hz else []
        if options.progress_hz:
            player.on_change = show_state
        if options.progress_hz > 0:
            helpers.append(_repeat(show_state, 1 / options.progress_hz))
        await first_of(_play_repeatedly(player, options.loop), *helpers)


async def _play_repeatedly(player: Player, is_loop: bool) -> None:
    await player.play()
    while is_loop and not player.is_stopped:
        await player.play()


async def _repeat(show: Callable[[], None], every_s: float) -> None:
    while True:
        show()
        await asyncio.sleep(every_s)


def _serve(node: Node, player: Player) -> None:
    """Create the services of a player."""
    timeline = player.timeline

    async def wait_for_start(kind: str) -> None:
        if kind in _NEED_START:
            await player.started()

    serve_rosbag2(
        node,
        f"{_PLAYER}/",
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
