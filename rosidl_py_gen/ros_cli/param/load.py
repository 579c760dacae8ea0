"""``param load``."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.base.output import printable_line
from rosidl_py_gen.ros_cli import options, report, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions


@click.command("load")
@options.node_argument()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, readable=True))
@options.node_timeout
@options.as_json
@options.node_options
@verb
async def load(network: NetworkOptions, node: str, file: str, timeout_s: float, as_json: bool) -> int:
    """Set what a parameter file says for a node.

    \b
    rosidl-py param load /talker talker.yaml
    """
    from rosidl_py_gen.ros_cli.param.remote import parameters_of

    async with parameters_of(network, node, timeout_s) as client:
        results = await client.load_yaml(file, timeout_s)
    if as_json:
        terminal_output.document({name: asdict(result) for name, result in results.items()})
    for name, result in () if as_json else results.items():
        reason = f": {result.reason}" if result.reason else ""
        if result.successful:
            terminal_output.line(f"Set parameter {name} successful{reason}")
        else:
            report(printable_line(f"Set parameter {name} failed{reason}"))
    return 0 if all(result.successful for result in results.values()) else 1
