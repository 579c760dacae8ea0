"""``tf monitor``: prints the rates and delays of transforms once a second."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.ros_cli import CommandError, options, terminal_output

if TYPE_CHECKING:
    from collections import deque

    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameArrivals


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
    await _Monitor(frames, times, window, as_json).run(command_node)


class _Monitor:
    def __init__(self, path: Sequence[str], times: int | None, window: int, as_json: bool) -> None:
        from collections import deque

        from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameStatistics

        self._path, self._times, self._as_json = path, times, as_json
        self._frames = FrameStatistics(window)
        self._ages_ns: deque[int] = deque(maxlen=window)
        self._last_note = ""

    async def run(self, command_node: CommandNode) -> None:
        from rosidl_py_gen.ros_cli.command_node import first_of
        from rosidl_py_gen.ros_cli.tf.frame_statistics import listeners

        await command_node.wait_for_discovery()
        await first_of(self._report(command_node), *listeners(command_node.node, self._frames, self._note_age))

    def _note_age(self, arrived_ns: int) -> None:
        if self._path and (age_ns := self._frames.age_ns(self._path[0], self._path[1], arrived_ns)) is not None:
            self._ages_ns.append(age_ns)

    async def _report(self, command_node: CommandNode) -> None:
        import asyncio

        from rosidl_py_gen.ros_cli.tf.frame_statistics import names_of

        left = self._times
        while left is None or left > 0:
            await asyncio.sleep(_REPORT_INTERVAL_S)
            frames = self._selected_frames()
            if not frames:
                continue
            names = names_of(command_node.node)
            if self._as_json:
                age = _mean_and_max(self._ages_ns)
                whole = {"net_delay_s": age and {"mean": age[0], "max": age[1]}} if self._path else {}
                terminal_output.document({"frames": [one.row(names) for one in frames], **whole}, in_stream=True)
            else:
                terminal_output.table((_row(one, names) for one in frames), *_HEADINGS)
                if self._path and (age := _mean_and_max(self._ages_ns)) is not None:
                    target, source = self._path
                    terminal_output.line(f"{source} in {target}: net delay {age[0]:.3f} s, max {age[1]:.3f} s", "bold")
            left = None if left is None else left - 1

    def _selected_frames(self) -> list[FrameArrivals]:
        from rosidl_py_gen.tf import TransformError

        if not self._path:
            if not self._frames.frames:
                self._note("no transforms yet")
            return sorted(self._frames.frames.values(), key=lambda one: one.name)
        try:
            return self._frames.between(*self._path)
        except TransformError as error:
            self._note(str(error))
        return []

    def _note(self, text: str) -> None:
        if text != self._last_note:
            self._last_note = text
            terminal_output.note(text)


def _mean_and_max(values_ns: deque[int]) -> tuple[float, float] | None:
    return (sum(values_ns) / len(values_ns) / NS_PER_S, max(values_ns) / NS_PER_S) if values_ns else None


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
