"""``tf tree``: shows the frames of the network or of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.terminal_text import printable_line
from rosidl_py_gen.ros_cli import AsyncCommand, CommandError, options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameStatistics


_TYPE = "tf2_msgs/msg/TFMessage"


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
        from rosidl_py_gen.ros_cli.tf import png  # noqa: F401 - a missing Pillow is reported before the wait
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
    from rosidl_py_gen.bags import BagReader
    from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameStatistics

    frames = FrameStatistics(window=10_000)
    with BagReader(path) as reader:
        topics = [name for name, topic in reader.topics.items() if topic.type_name == _TYPE]
        if not topics:
            raise CommandError(f"{path} has no topic of {_TYPE}")
        for one in reader.messages(topics):
            frames.add_message(one.message, one.log_time, one.topic, static=one.topic.endswith("/tf_static"))
        _show(frames, {name: name for name in topics}, kind, output)


def _show(frames: FrameStatistics, names: dict[Any, str], kind: str, output: str | None) -> None:
    from rosidl_py_gen.ros_cli.tf import text

    for problem in text.problems(frames):
        terminal_output.note(f"warning: {problem}")
    if kind == "png":
        from rosidl_py_gen.ros_cli.tf import png

        assert output is not None
        png.write(frames, names, Path(output))
    elif output is None and kind == "text":
        for line, style in text.lines(frames, names):
            terminal_output.line(line, style)
    elif output is None:
        terminal_output.block(_text(frames, names, kind).rstrip("\n"))
    else:
        Path(output).write_text(_text(frames, names, kind), encoding="utf-8")
    if output is not None:
        terminal_output.note(f"wrote {output}: {len(frames.frames) + len(frames.roots())} frames")


def _text(frames: FrameStatistics, names: dict[Any, str], kind: str) -> str:
    from rosidl_py_gen.ros_cli.tf import text

    if kind == "json":
        return text.as_json(frames, names)
    if kind == "mermaid":
        return text.mermaid(frames, names)
    if kind == "markdown":
        return f"```mermaid\n{text.mermaid(frames, names)}```\n"
    return "".join(f"{printable_line(line)}\n" for line, _ in text.lines(frames, names))
