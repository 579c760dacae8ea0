"""``param dump``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions


@click.command("dump")
@options.node_argument()
@click.option("-o", "--output", type=click.Path(dir_okay=False, writable=True), metavar="FILE", help="Write it there.")
@options.node_timeout
@options.as_json
@options.node_options
@verb
async def dump(network: NetworkOptions, node: str, output: str | None, timeout_s: float, as_json: bool) -> int:
    """Print all parameters of a node as a parameter file.

    \b
    rosidl-py param dump /talker -o talker.yaml
    """
    import asyncio

    from rosidl_py_gen.ros_cli.command_node import now_s
    from rosidl_py_gen.ros_cli.param.remote import parameters_of

    end_s = now_s() + timeout_s

    def left_s() -> float:
        return max(0.0, end_s - now_s())

    async with parameters_of(network, node, timeout_s) as client:
        values = await client.get_all(left_s()) if as_json else {}
        text = "" if as_json and output is None else await client.dump_yaml(left_s())
    if output is not None:
        await asyncio.to_thread(Path(output).write_text, text, encoding="utf-8")
        terminal_output.note(f"wrote {output}")
    if as_json:
        shown = {name: list(value) if isinstance(value, tuple | bytes) else value for name, value in values.items()}
        terminal_output.document({client.node: shown})
    elif output is None:
        terminal_output.block(text.rstrip("\n"))
    return 0
