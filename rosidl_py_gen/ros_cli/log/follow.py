"""``log``: what nodes log now and keep of before, or what was logged in a recording.

Decides that what nodes kept is printed in the order of its times: it comes node by node.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.stamps import stamp_ns
from rosidl_py_gen.ros_cli import AsyncCommand, ToolError, options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import CommandNode, NetworkOptions
    from rosidl_py_gen.ros_cli.log.lines import Lines
    from rosidl_py_gen.runtime import AdaptiveSubscription, QoSProfile


_TOPIC, _TYPE, _DEPTH = "/rosout", "rcl_interfaces/msg/Log", 1000
_KEPT_S = 0.3
"""How long what was kept may take; nodes send it at once."""


@click.command("log")
@click.option(
    "-l",
    "--level",
    type=click.Choice(["debug", "info", "warn", "error", "fatal"], case_sensitive=False),
    default="debug",
    help="Only this level and above.",
)
@click.option(
    "--node",
    "nodes",
    multiple=True,
    metavar="NAME",
    shell_complete=options.completion("nodes"),
    help="Only loggers of this node, /ns/name or ns.name; * stands for anything, may be given several times.",
)
@click.option("-t", "--text", "pattern", metavar="REGEX", help="Only texts in which this is found.")
@click.option("-n", "--times", type=click.IntRange(1), metavar="COUNT", help="Stop after so many.")
@click.option("--new", "only_new", is_flag=True, help="Nothing of before now, which nodes keep for ten seconds.")
@click.option("-v", "--verbose", is_flag=True, help="Show file, line and function, too.")
@click.option("--bag", metavar="PATH", type=click.Path(), help="What was logged in a recording, and then end.")
@options.as_json
@options.node_options
@verb
def log(
    network: NetworkOptions,
    level: str,
    nodes: Sequence[str],
    pattern: str | None,
    times: int | None,
    only_new: bool,
    verbose: bool,
    as_json: bool,
    bag: str | None,
) -> AsyncCommand | int:
    """Follow what all nodes log, from /rosout.

    \b
    rosidl-py log
    rosidl-py log --level warn --node '/camera*'
    rosidl-py log --bag drive.mcap --text 'lost|late'
    """
    from rosidl_py_gen.ros_cli.log.lines import Lines

    if bag is not None and only_new:
        raise click.UsageError("nothing is new in a recording: give --bag or --new")
    lines = Lines(level, nodes, pattern, times=times, verbose=verbose, as_json=as_json)
    if bag is None:
        return AsyncCommand(_follow(network, lines, only_new), endless=times is None)
    return _show_recorded(bag, lines)


def _show_recorded(path: str, lines: Lines) -> int:
    from rosidl_py_gen.bags import BagReader

    with BagReader(path) as reader:
        topics = [name for name, topic in reader.topics.items() if topic.type_name == _TYPE]
        if not topics:
            raise ToolError(f"{path} has no topic of {_TYPE}: nothing that nodes logged was recorded")
        for one in reader.messages(topics):
            if lines.is_done:
                break
            lines.show(one.message)
    return 0


async def _follow(network: NetworkOptions, lines: Lines, only_new: bool) -> int:
    from rosidl_py_gen import get_message
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.runtime import AdaptiveSubscription

    async with CommandNode(network) as session:
        await session.wait_for_discovery()
        cls: Any = get_message(_TYPE)
        qos = _profile(session, only_new)
        following: AdaptiveSubscription[Any] = AdaptiveSubscription(
            session.node, _TOPIC, cls, qos=qos, depth=_DEPTH, note=terminal_output.note
        )
        async with following as messages:
            for message in await _kept(messages):
                lines.show(message)
            while not lines.is_done:
                message, _ = await messages.receive_with_info()
                lines.show(message)
    return 0


def _profile(session: CommandNode, only_new: bool) -> QoSProfile | None:
    """What nodes offer, so that those that come later are heard from their first word; None if any offers less."""
    from rosidl_py_gen.runtime import Durability, QoSProfile, Reliability

    if only_new:
        return QoSProfile(depth=_DEPTH)
    for one in session.node.get_publishers_info_by_topic(_TOPIC):
        offered = one.qos_profile
        if (offered.reliability, offered.durability) != (Reliability.RELIABLE, Durability.TRANSIENT_LOCAL):
            return None
    return QoSProfile(depth=_DEPTH).transient_local()


async def _kept(messages: AdaptiveSubscription[Any]) -> list[Any]:
    from rosidl_py_gen.ros_cli.command_node import now_s
    from rosidl_py_gen.runtime import WaitTimeoutError

    found = []
    end_s = now_s() + _KEPT_S
    try:
        while (left_s := end_s - now_s()) > 0:
            found.append((await messages.receive_with_info(left_s))[0])
    except WaitTimeoutError:
        pass
    return sorted(found, key=lambda message: stamp_ns(message.stamp))
