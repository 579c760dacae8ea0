"""Command ``tf tree``: shows the frames of the network or of a recording, as text, Mermaid, JSON or PNG."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.terminal_text import json_text, pluralize
from rosidl_py_gen.ros_cli import AsyncCommand, options, terminal_output, verb
from rosidl_py_gen.ros_cli.command_support import CommandError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameStatistics


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

    from rosidl_py_gen.ros_cli.command_node import CommandNode, first_of
    from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameStatistics, listeners, names_of

    frames = FrameStatistics()
    async with CommandNode(network) as command_node:
        await command_node.wait_for_discovery()
        await first_of(asyncio.sleep(wait_s), *listeners(command_node.node, frames))
        await command_node.wait_for(command_node.node.node_names_complete, 1.0)
        names = names_of(command_node.node)
    await asyncio.to_thread(_show, frames, names, kind, output)


def _show_recorded(path: str, kind: str, output: str | None) -> None:
    from rosidl_py_gen.ros_cli.bag.display import messages_of_type
    from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameStatistics

    frames = FrameStatistics(window=10_000)
    topics = {}
    for one in messages_of_type(path, _TYPE):
        topics[one.topic] = one.topic
        frames.add_message(one.message, one.log_time, one.topic, static=one.topic.endswith("/tf_static"))
    _show(frames, topics, kind, output)


def _show(frames: FrameStatistics, names: dict[Any, str], kind: str, output: str | None) -> None:
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
