"""``param dump`` and ``param load``: parameter files."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from rosidl_py_gen.base.terminal_text import printable_line
from rosidl_py_gen.ros_cli import options, report, terminal_output, verb


@click.command("dump")
@options.node_argument()
@click.option("-o", "--output", type=click.Path(dir_okay=False, writable=True), metavar="FILE", help="Write to a file.")
@options.node_timeout
@options.as_json
@options.node_options
@verb
async def dump(network: options.NetworkOptions, node: str, output: str | None, timeout_s: float, as_json: bool) -> int:
    """Print all parameters of a node as a parameter file.

    \b
    rosidl-py param dump /talker -o talker.yaml
    """
    import asyncio

    from rosidl_py_gen.ros_cli.command_node import now_s
    from rosidl_py_gen.ros_cli.param.parameter_access import parameters_of, plain_parameter

    end_s = now_s() + timeout_s
    async with parameters_of(network, node, timeout_s) as client:
        values = await client.get_all(max(0.0, end_s - now_s())) if as_json else {}
        text = "" if as_json and output is None else await client.dump_yaml(max(0.0, end_s - now_s()))
    if output is not None:
        await asyncio.to_thread(Path(output).write_text, text, encoding="utf-8")
        terminal_output.note(f"wrote {output}")
    if as_json:
        terminal_output.document({client.node: {name: plain_parameter(value) for name, value in values.items()}})
    elif output is None:
        terminal_output.block(text.rstrip("\n"))
    return 0


@click.command("load")
@options.node_argument()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, readable=True))
@options.node_timeout
@options.as_json
@options.node_options
@verb
async def load(network: options.NetworkOptions, node: str, file: str, timeout_s: float, as_json: bool) -> int:
    """Set the parameters of a node that a parameter file contains.

    \b
    rosidl-py param load /talker talker.yaml
    """
    from rosidl_py_gen.ros_cli.param.parameter_access import parameters_of

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
