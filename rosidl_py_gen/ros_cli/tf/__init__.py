"""Commands of ``rosidl-py tf``: echo, monitor and tree.

``echo`` prints one transform repeatedly, in the form of tf2_echo. ``monitor`` prints the rates and delays of transforms
once a second. ``tree`` shows the frames of the network or of a recording, as text, Mermaid, JSON or PNG.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.stamps import sec_nanosec
from rosidl_py_gen.base.terminal_text import json_text, pluralize
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.ros_cli import AsyncCommand, options, verb

if TYPE_CHECKING:
    from collections import deque
    from collections.abc import Iterator

    import numpy as np

    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameArrivals, FrameStatistics
    from rosidl_py_gen.tf import Transform


@click.command("echo")
@click.argument("target")
@click.argument("source")
@click.option("--once", is_flag=True, help="Print one transform and end.")
@options.report_count
@options.rate("-r", "--rate", "rate_hz", default=1.0, help="Lookups per second.")
@click.option(
    "-p",
    "--precision",
    type=click.IntRange(0, 17),
    metavar="N",
    default=3,
    show_default=True,
    help="Number of decimals.",
)
@options.timeout("Maximum time to wait for the first transform.", 10)
@options.as_json
@options.endless_node_verb(lambda arguments: not (arguments["once"] or arguments["times"]))
async def echo(
    command_node: CommandNode,
    target: str,
    source: str,
    once: bool,
    times: int | None,
    rate_hz: float,
    precision: int,
    timeout_s: float,
    as_json: bool,
) -> None:
    """Print the transform from SOURCE to TARGET repeatedly: the pose of SOURCE in TARGET.

    \b
    rosidl-py tf echo map base_link
    rosidl-py tf echo odom lidar --once --json
    """
    import asyncio

    from rosidl_py_gen.tf import InvalidTransformError, TransformBuffer, TransformError, TransformTimeoutError

    left = 1 if once else times
    buffer = TransformBuffer(command_node.node)
    try:
        await buffer.wait_for_transform(target, source, timeout_s=timeout_s)
    except (TransformTimeoutError, InvalidTransformError) as error:
        raise CommandError(f'no transform from "{source}" to "{target}": {error}') from None
    while left is None or left > 0:
        try:
            _print_transform(buffer.lookup_transform(target, source), precision, as_json)
            left = None if left is None else left - 1
        except TransformError as error:
            terminal_output.note(f"warning: {error}")
        if left != 0:
            await asyncio.sleep(1 / rate_hz)


def _print_transform(transform: Transform, precision: int, as_json: bool) -> None:
    import numpy as np

    from rosidl_py_gen.numpy import quaternion_to_euler

    euler = np.array(quaternion_to_euler(transform.rotation))
    if as_json:
        terminal_output.document(
            {
                "target": transform.target,
                "source": transform.source,
                "stamp_ns": transform.stamp,
                "translation": transform.translation.tolist(),
                "rotation": transform.rotation.tolist(),
                "euler": euler.tolist(),
            },
            in_stream=True,
        )
        return

    def text(numbers: np.ndarray[tuple[int, ...], np.dtype[np.float64]], between: str = ", ") -> str:
        return between.join(f"{round(number, precision) + 0.0:.{precision}f}" for number in numbers.tolist())

    seconds, rest = sec_nanosec(transform.stamp)
    rows = "\n".join(f"  {text(row, '  ')}" for row in transform.matrix)
    terminal_output.block(
        f"At time {seconds}.{rest:09}\n"
        f"- Translation: [{text(transform.translation)}]\n"
        f"- Rotation: in Quaternion (xyzw) [{text(transform.rotation)}]\n"
        f"- Rotation: in RPY (radian) [{text(euler)}]\n"
        f"- Rotation: in RPY (degree) [{text(np.degrees(euler))}]\n"
        f"- Matrix:\n{rows}"
    )


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

    from rosidl_py_gen.command_support import first_of
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


_TYPE = "tf2_msgs/msg/TFMessage"
_MAX_COLUMNS = 60


@click.command("tree")
@options.output_format_options("png")
@options.seconds("--wait-time", "wait_s", maximum=3600, default=2.0, help="Time to listen.")
@click.option("--bag", metavar="PATH", type=click.Path(), help="Show the frames of a recording instead of the network.")
@options.node_options
@verb
def tree(
    network: options.NetworkOptions, kind: str | None, as_json: bool, output: str | None, wait_s: float, bag: str | None
) -> AsyncCommand | None:
    """Show the parent of each frame, and the rate, delay and node of its transform.

    \b
    rosidl-py tf tree
    rosidl-py tf tree -o frames.png
    rosidl-py tf tree --bag drive.mcap --format mermaid
    """
    kind = options.output_format("png", kind, as_json, output)
    if kind == "png":
        if output is None:
            raise CommandError("a PNG picture cannot be printed; write it to a file: -o frames.png")
        import_module("rosidl_py_gen.ros_cli.tf.png")  # a missing Pillow is reported before the wait
    if bag is None:
        return AsyncCommand(_show_live(network, kind, output, wait_s))
    _show_recorded(bag, kind, output)
    return None


async def _show_live(network: options.NetworkOptions, kind: str, output: str | None, wait_s: float) -> None:
    import asyncio

    from rosidl_py_gen.command_support import CommandNode, first_of
    from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameStatistics, listeners, names_of

    frames = FrameStatistics()
    async with CommandNode(network) as command_node:
        await command_node.wait_for_discovery()
        await first_of(asyncio.sleep(wait_s), *listeners(command_node.node, frames))
        await command_node.wait_for(command_node.node.node_names_complete, 1.0)
        names = names_of(command_node.node)
    await asyncio.to_thread(_show_frames, frames, names, kind, output)


def _show_recorded(path: str, kind: str, output: str | None) -> None:
    from rosidl_py_gen.ros_cli.bag.reading import messages_of_type
    from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameStatistics

    frames = FrameStatistics(window=10_000)
    topics = {}
    for one in messages_of_type(path, _TYPE):
        topics[one.topic] = one.topic
        frames.add_message(one.message, one.log_time, one.topic, static=one.topic.endswith("/tf_static"))
    _show_frames(frames, topics, kind, output)


def _show_frames(frames: FrameStatistics, names: dict[Any, str], kind: str, output: str | None) -> None:
    for problem in _problems(frames):
        terminal_output.note(f"warning: {problem}")
    if kind == "png":
        from rosidl_py_gen.ros_cli.tf.png import write_picture

        assert output is not None
        write_picture(frames, names, Path(output))
    else:
        draw = {"json": lambda: json_text(document(frames, names), indent=2), "mermaid": lambda: mermaid(frames, names)}
        terminal_output.drawing(kind, output, lines(frames, names), draw)
    if output is not None:
        terminal_output.note(f"wrote {output}: {pluralize(len(frames.frames) + len(frames.roots()), 'frame')}")


def lines(frames: FrameStatistics, names: dict[Any, str]) -> Iterator[tuple[str, str]]:
    """Yield a line of text for each frame of the tree, and the style of rich for the line."""
    rows = []
    for name, frame, last in frames.walk():
        marks = "".join("   " if one else "│  " for one in last[:-1])
        branch = "" if frame is None else "└─ " if last[-1] else "├─ "
        rows.append((f"{marks}{branch}{name}", "" if frame is None else frame.summary(names)))
    width = min(max((len(row[0]) for row in rows), default=0), _MAX_COLUMNS)
    for tree, text in rows:
        yield f"{tree:<{width}}  {text}".rstrip(), "" if text else "bold"
    if not rows and not frames.frames:
        yield "no transforms", ""


def _problems(frames: FrameStatistics) -> Iterator[str]:
    """Yield warnings about the whole tree: unconnected trees, loops, frames with several publishers."""
    roots = frames.roots()
    if len(roots) > 1:
        yield f"{len(roots)} trees that are not connected: {', '.join(roots[:20])}"
    if loop := frames.frames_in_cycles():
        yield f"frames that form a loop, or are below one: {', '.join(loop[:20])}"
    for frame in frames.frames.values():
        if len(frame.sources) > 1 and not frame.is_static:
            yield f"{frame.name} comes from {pluralize(len(frame.sources), 'publisher')}"


def mermaid(frames: FrameStatistics, names: dict[Any, str]) -> str:
    """Return a Mermaid flowchart of the frames from top to bottom.

    The arrow to a frame has the summary of its transforms.
    """
    every = sorted({*frames.frames, *(frame.parent for frame in frames.frames.values())})
    ids = {name: f"f{number}" for number, name in enumerate(every)}
    out = ["flowchart TD"]
    out += [f'  {mark}["{terminal_output.mermaid_label(name)}"]' for name, mark in ids.items()]
    for frame in sorted(frames.frames.values(), key=lambda one: one.name):
        line = "-.->" if frame.is_static else "-->"
        text = terminal_output.mermaid_label(frame.summary(names))
        out.append(f'  {ids[frame.parent]} {line}|"{text}"| {ids[frame.name]}')
    return "\n".join(out) + "\n"


def document(frames: FrameStatistics, names: dict[Any, str]) -> dict[str, Any]:
    """Return a value for JSON output: the names of the root frames, and the statistics of all other frames."""
    rows = [frame.row(names) for frame in sorted(frames.frames.values(), key=lambda one: one.name)]
    return {"roots": frames.roots(), "frames": rows}
