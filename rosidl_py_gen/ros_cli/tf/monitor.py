"""Command ``tf monitor``: prints the rates and delays of transforms once a second."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import options, terminal_output
from rosidl_py_gen.ros_cli.command_support import CommandError

if TYPE_CHECKING:
    from collections import deque

    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameArrivals, FrameStatistics


_REPORT_INTERVAL_S = 1.0
_HEADINGS = ("frame", "parent", "rate", "delay", "max_delay", "publishers")


@click.command("monitor")
@click.argument("frames", nargs=-1)
@options.report_count
@options.window(1000)
@options.as_json
@options.endless_node_verb(lambda arguments: arguments["times"] is None)
async def monitor(
    command_node: CommandNode, frames: Sequence[str], times: int | None, window: int, as_json: bool
) -> None:
    """Print once a second the rate and the delay of the transform of each frame.

    With two FRAMES, print only the frames between them, and the age of the transform from one to the other.

    \b
    rosidl-py tf monitor
    rosidl-py tf monitor map lidar
    """
    if len(frames) not in (0, 2):
        raise CommandError(f"expected no frames or two, got {len(frames)}")
    if len({*frames}) == 1:
        raise CommandError(f"expected two different frames, got {frames[0]} twice")
    from collections import deque

    from rosidl_py_gen.ros_cli.command_node import first_of
    from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameStatistics, listeners

    statistics = FrameStatistics(window)
    ages_ns: deque[int] = deque(maxlen=window)

    def note_age(arrived_ns: int) -> None:
        if frames and (age_ns := statistics.age_ns(frames[0], frames[1], arrived_ns)) is not None:
            ages_ns.append(age_ns)

    await command_node.wait_for_discovery()
    report = _report(command_node, statistics, frames, ages_ns, times, as_json)
    await first_of(report, *listeners(command_node.node, statistics, note_age))


async def _report(
    command_node: CommandNode,
    statistics: FrameStatistics,
    path: Sequence[str],
    ages_ns: deque[int],
    left: int | None,
    as_json: bool,
) -> None:
    import asyncio

    from rosidl_py_gen.ros_cli.tf.frame_statistics import mean_and_max_s, names_of

    last_reason = ""
    while left is None or left > 0:
        await asyncio.sleep(_REPORT_INTERVAL_S)
        frames, reason = _selected_frames(statistics, path)
        if reason not in ("", last_reason):
            terminal_output.note(reason)
            last_reason = reason
        if not frames:
            continue
        names, age = names_of(command_node.node), mean_and_max_s(ages_ns)
        if as_json:
            whole = {"net_delay_s": age and {"mean": age[0], "max": age[1]}} if path else {}
            terminal_output.document({"frames": [one.row(names) for one in frames], **whole}, in_stream=True)
        else:
            terminal_output.table((_row(one, names) for one in frames), *_HEADINGS)
            if path and age is not None:
                text = f"{path[1]} in {path[0]}: net delay {age[0]:.3f} s, max {age[1]:.3f} s"
                terminal_output.line(text, "bold")
        left = None if left is None else left - 1


def _selected_frames(statistics: FrameStatistics, path: Sequence[str]) -> tuple[list[FrameArrivals], str]:
    """Return the frames to print; if there are none, also a text with the reason, else ""."""
    from rosidl_py_gen.tf import TransformError

    if not path:
        frames = sorted(statistics.frames.values(), key=lambda one: one.name)
        return frames, "" if frames else "no transforms yet"
    try:
        return statistics.between(*path), ""
    except TransformError as error:
        return [], str(error)


def _row(frame: FrameArrivals, names: dict[Any, str]) -> list[str]:
    rate, delay = frame.rate_hz, frame.delay_s
    return [
        frame.name,
        frame.parent,
        "static" if frame.is_static else "" if rate is None else f"{rate:.3f}",
        "" if delay is None else f"{delay[0]:.3f}",
        "" if delay is None else f"{delay[1]:.3f}",
        ", ".join(frame.publishers(names)),
    ]
