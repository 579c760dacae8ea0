"""Command ``bag plot``: plots fields of recorded messages over time."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.plotting import Plot
from rosidl_py_gen.ros_cli import DAMAGED, options, verb

if TYPE_CHECKING:
    from rosidl_py_gen.bags import BagReader


@click.command("plot")
@click.argument(
    "words",
    nargs=-1,
    required=True,
    type=click.Path(),
    metavar="BAG... /TOPIC FIELD...",
    shell_complete=options.plot_completion("bag"),
)
@options.start_offset
@options.duration
@options.plot_options
@options.skip_damaged
@options.paths
@verb
def plot(
    words: Sequence[str],
    offset_s: float,
    duration_s: float | None,
    wall_clock: bool,
    by_stamp: bool,
    in_terminal: bool,
    out: str | None,
    skips: bool,
    paths: Sequence[str],
) -> int:
    """Plot fields of topics over time.

    The plot is written to --out, shown in a window, or drawn in the terminal if there is no display. FIELD is
    pose.pose.position.x, ranges[0], ranges[0:5], or a message such as twist.linear, which gives a line for each of its
    numbers. Further topics get a plot below. Of several bags each starts at 0 s, unless --wall-clock is used. Needs the
    extra plot.

    \b
    rosidl-py bag plot drive /imu angular_velocity
    rosidl-py bag plot drive /imu linear_acceleration.x /odom twist.twist.linear.x --out drive.svg
    """
    plot = Plot(out, in_terminal, is_wall_clock=wall_clock, by_stamp=by_stamp)
    from rosidl_py_gen.ros_cli.bag.reading import opened_bag

    with ExitStack() as stack:
        bags: list[BagReader] = []
        rest = list(words)
        while rest and (not bags or _is_bag(rest[0], bags[0])):
            bags.append(stack.enter_context(opened_bag(rest.pop(0), search_path=paths, skip_damaged=skips)))
        topics = options.topics_and_fields(rest)
        if not topics:
            raise CommandError(f"expected a topic and fields after the bag; {_topics_text(bags[0])}")
        skipped = False
        for bag in bags:
            prefix = f"{bag.path.name}: " if len(bags) > 1 else ""
            _add_panels(plot, bag, topics, prefix, offset_s, duration_s, skips)
            skipped = skipped or bool(bag.damaged or bag.skipped)
        plot.show(own_starts=len(bags) > 1)
    return DAMAGED if skipped else 0


def _is_bag(word: str, first: BagReader) -> bool:
    """Return True if an argument after the first bag is a further bag: a URL, or a path that exists and is
    not a topic.
    """
    from rosidl_py_gen.bags import BagLocation

    return BagLocation(word).is_url or (word not in first.topics and os.path.exists(word))


def _topics_text(bag: BagReader) -> str:
    return f"topics of {bag.path}: {', '.join(sorted(bag.topics)) or 'none'}"


def _add_panels(
    plot: Plot,
    bag: BagReader,
    topics: Sequence[tuple[str, list[str]]],
    prefix: str,
    offset_s: float,
    duration_s: float | None,
    skips: bool,
) -> None:
    """Add a panel for each topic to a plot, filled with fields of messages from one bag, which is read once."""
    from rosidl_py_gen.ros_cli.bag.reading import ProgressBar, select_part

    part = select_part(bag, [name for name, _ in topics], offset_s, duration_s)
    lines = {name: plot.add_topic(name, fields, prefix) for name, fields in topics}
    for name, one in lines.items():
        for channel in bag.channels:
            if channel.name == name:
                one.use(bag.message_class(channel))
    on_error = "skip" if skips else "raise"
    total = sum(bag.topics[name].count or 0 for name in lines)
    with ProgressBar("messages") as show:
        messages = bag.messages(part.topics, start_ns=part.start_ns, end_ns=part.end_ns, on_error=on_error)  # type: ignore[call-overload]
        for message in show.each(messages, total):
            lines[message.topic].add(message.message, message.log_time)
    for name, one in lines.items():
        if not one.panel.count:
            raise CommandError(f"{bag.path} has no messages on {name} in the selected time")
