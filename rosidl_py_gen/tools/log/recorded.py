"""``log --bag``: what was logged in a recording."""

from __future__ import annotations

from collections.abc import Sequence

import click

from rosidl_py_gen.bags import BagReader
from rosidl_py_gen.tools import ToolError
from rosidl_py_gen.tools.log.lines import Lines

_TYPE = "rcl_interfaces/msg/Log"


def run(
    path: str,
    level: str,
    nodes: Sequence[str],
    pattern: str | None,
    times: int | None,
    verbose: bool,
    as_json: bool,
    only_new: bool,
) -> int:
    """What the command does. Raises `click.UsageError`: options that do not go together."""
    if only_new:
        raise click.UsageError("nothing is new in a recording: give --bag or --new")
    lines = Lines(level, nodes, pattern, times=times, verbose=verbose, as_json=as_json)
    with BagReader(path) as reader:
        topics = [name for name, topic in reader.topics.items() if topic.type_name == _TYPE]
        if not topics:
            raise ToolError(f"{path} has no topic of {_TYPE}: nothing that nodes logged was recorded")
        for one in reader.messages(topics):
            if lines.is_done:
                break
            lines.show(one.message)
    return 0
