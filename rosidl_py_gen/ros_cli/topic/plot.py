"""Command ``topic plot``: plots fields of received messages over time."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AsyncExitStack
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.plotting import Plot
from rosidl_py_gen.ros_cli import options
from rosidl_py_gen.ros_cli.topic import qos_options, requested_profile

if TYPE_CHECKING:
    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.plotting import TopicLines
    from rosidl_py_gen.runtime import AdaptiveSubscription


@click.command("plot")
@click.argument(
    "words", nargs=-1, required=True, metavar="/TOPIC FIELD...", shell_complete=options.plot_completion("graph")
)
@options.seconds("--duration", "duration_s", help="Time to receive messages; without it until Ctrl-C.")
@click.option("-n", "--times", type=click.IntRange(1), metavar="N", help="Stop after N messages.")
@options.seconds("--last", "last_s", help="Draw only this time before the latest message.")
@options.plot_options
@options.topic_timeout
@qos_options
@options.paths
@options.endless_node_verb(lambda arguments: arguments["duration_s"] is None and arguments["times"] is None)
async def plot(
    command_node: CommandNode,
    words: Sequence[str],
    duration_s: float | None,
    times: int | None,
    last_s: float | None,
    wall_clock: bool,
    by_stamp: bool,
    in_terminal: bool,
    out: str | None,
    timeout_s: float | None,
    qos: dict[str, Any],
    paths: Sequence[str],
) -> None:
    """Plot fields of topics while messages arrive.

    The plot is drawn in a window, or in the terminal if there is no display; --out writes a file at the end. FIELD is
    pose.pose.position.x, ranges[0], ranges[0:5], or a message such as twist.linear, which gives a line for each of its
    numbers. Further topics get a plot below. Needs the extra plot.

    \b
    rosidl-py topic plot /imu angular_velocity
    rosidl-py topic plot /imu linear_acceleration.x /odom twist.twist.linear.x --last 10
    rosidl-py topic plot /battery percentage --duration 60 --out battery.png
    """
    plot = Plot(out, in_terminal, is_wall_clock=wall_clock, by_stamp=by_stamp, last_s=last_s)
    from rosidl_py_gen.command_support import interface_class
    from rosidl_py_gen.runtime import AdaptiveSubscription
    from rosidl_py_gen.runtime import qos as presets

    profile = requested_profile(qos, presets.SENSOR_DATA)
    lines: list[TopicLines] = []
    subscriptions: list[AdaptiveSubscription[Any]] = []
    async with AsyncExitStack() as stack:
        for topic, fields in options.topics_and_fields(words):
            name = await command_node.find("topic", topic, timeout_s)
            cls = await interface_class(command_node, "topic", name, paths=paths)
            one = plot.add_topic(name, fields)
            one.use(cls)
            lines.append(one)
            subscription: AdaptiveSubscription[Any] = AdaptiveSubscription(
                command_node.node, name, cls, qos=profile, note=terminal_output.note
            )
            subscriptions.append(await stack.enter_async_context(subscription))
        await _plot_live(plot, lines, subscriptions, duration_s, times)


async def _plot_live(
    plot: Plot,
    lines: Sequence[TopicLines],
    subscriptions: Sequence[AdaptiveSubscription[Any]],
    duration_s: float | None,
    times: int | None,
) -> None:
    """Receive messages and draw the plot until time or number is reached, the window is closed, or Ctrl-C."""
    import asyncio

    from rosidl_py_gen.command_support import first_of

    async def receive(one: TopicLines, subscription: AdaptiveSubscription[Any]) -> None:
        while times is None or plot.count < times:
            message, info = await subscription.receive_with_info()
            one.add(message, info.received_timestamp_ns)

    cancelled: asyncio.CancelledError | None = None
    with plot.live() as live:

        async def draw() -> None:
            loop = asyncio.get_running_loop()
            while live.is_open:
                live.update(loop.time())
                await asyncio.sleep(live.interval_s)

        limit = [] if duration_s is None else [asyncio.sleep(duration_s)]
        receiving = [receive(*pair) for pair in zip(lines, subscriptions, strict=True)]
        try:
            await first_of(*limit, draw(), *receiving)
        except asyncio.CancelledError as error:
            cancelled = error
    if cancelled is None and duration_s is not None and not plot.count:
        names = ", ".join(panel.title for panel in plot.panels)
        raise CommandError(f"no message on {names} in {duration_s:g} s")
    plot.end(live)
    if cancelled is not None:
        raise cancelled
