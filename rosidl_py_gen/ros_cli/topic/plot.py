"""Command ``topic plot``: plots fields of received messages over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack, ExitStack
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.plotting import count_text, live_plot, plot_window, print_plot, require_output, show_plot
from rosidl_py_gen.ros_cli import options
from rosidl_py_gen.ros_cli.topic import qos_options, requested_profile

if TYPE_CHECKING:
    from rosidl_py_gen.command_support.command_node import CommandNode
    from rosidl_py_gen.plotting import TimeAxis, TopicLines
    from rosidl_py_gen.runtime import AdaptiveSubscription

_WINDOW_INTERVAL_S = 0.05
"""Time between two checks for events of the plot window, in seconds; if longer, the window seems to hang."""
_DRAW_INTERVAL_S = 0.25


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
    require_output(out, in_terminal)
    from rosidl_py_gen.command_support import graph_lookup
    from rosidl_py_gen.plotting import PlotPanel, TimeAxis, TopicLines, topics_and_fields
    from rosidl_py_gen.runtime import AdaptiveSubscription
    from rosidl_py_gen.runtime import qos as presets

    axis = TimeAxis(is_wall_clock=wall_clock, by_stamp=by_stamp, last_s=last_s)
    profile = requested_profile(qos, presets.SENSOR_DATA)
    lines: list[TopicLines] = []
    subscriptions: list[AdaptiveSubscription[Any]] = []
    async with AsyncExitStack() as stack:
        for topic, fields in topics_and_fields(words):
            name = await command_node.find("topic", topic, timeout_s)
            cls = await graph_lookup.interface_class(command_node, "topic", name, paths=paths)
            one = TopicLines(PlotPanel(name), name, fields, by_stamp=by_stamp)
            one.use(cls)
            lines.append(one)
            subscription: AdaptiveSubscription[Any] = AdaptiveSubscription(
                command_node.node, name, cls, qos=profile, note=terminal_output.note
            )
            subscriptions.append(await stack.enter_async_context(subscription))
        await _plot_live(lines, subscriptions, axis, duration_s, times, out, in_terminal)


async def _plot_live(
    lines: Sequence[TopicLines],
    subscriptions: Sequence[AdaptiveSubscription[Any]],
    axis: TimeAxis,
    duration_s: float | None,
    times: int | None,
    out: str | None,
    in_terminal: bool,
) -> None:
    """Receive messages and draw the plot until time or number is reached, the window is closed, or Ctrl-C."""
    import asyncio

    from rosidl_py_gen.command_support.command_node import first_of

    panels = [one.panel for one in lines]

    def is_complete() -> bool:
        return times is not None and sum(panel.count for panel in panels) >= times

    async def receive(one: TopicLines, subscription: AdaptiveSubscription[Any]) -> None:
        while not is_complete():
            message, info = await subscription.receive_with_info()
            one.add(message, info.received_timestamp_ns)
            if axis.last_s is not None:
                for line in one.panel.lines:
                    line.retain_last(axis.last_s)

    cancelled: asyncio.CancelledError | None = None
    with ExitStack() as stack:
        window = None if out else stack.enter_context(plot_window(len(panels), in_terminal))
        show: Callable[..., None] = lambda panels, axis: None  # noqa: E731
        if window is None and out is None:
            show = stack.enter_context(live_plot())

        async def draw() -> None:
            drawn, next_s = 0, 0.0
            loop = asyncio.get_running_loop()
            while window is None or window.is_open:
                is_due = (total := sum(panel.count for panel in panels)) > drawn and loop.time() >= next_s
                if is_due:
                    axis.begin(panels)
                    drawn, next_s = total, loop.time() + _DRAW_INTERVAL_S
                if window is not None:
                    window.update(panels if is_due else None, axis)
                elif is_due:
                    show(panels, axis)
                await asyncio.sleep(_WINDOW_INTERVAL_S if window is not None else _DRAW_INTERVAL_S)

        limit = [] if duration_s is None else [asyncio.sleep(duration_s)]
        receiving = [receive(*pair) for pair in zip(lines, subscriptions, strict=True)]
        try:
            await first_of(*limit, draw(), *receiving)
        except asyncio.CancelledError as error:
            cancelled = error
    if cancelled is None and duration_s is not None and not any(panel.count for panel in panels):
        names = ", ".join(panel.title for panel in panels)
        raise CommandError(f"no message on {names} in {duration_s:g} s")
    _finish(panels, axis, out, window is None)
    if cancelled is not None:
        raise cancelled


def _finish(panels: Sequence[Any], axis: TimeAxis, out: str | None, is_text: bool) -> None:
    """Write the plot to the file `out`, or print it a last time; print a note for each topic without messages."""
    filled = [panel for panel in panels if panel.count]
    for panel in panels:
        if not panel.count:
            terminal_output.note(f"no messages arrived on {panel.title}")
    if not filled:
        return
    if out is not None:
        show_plot(filled, axis, out, in_terminal=True)
    elif is_text:
        axis.begin(filled)
        print_plot(filled, axis)
    else:
        terminal_output.line(count_text(filled))
