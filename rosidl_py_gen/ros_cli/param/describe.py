"""``param describe``."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions
    from rosidl_py_gen.runtime import ParameterDescriptor


@click.command("describe")
@options.node_argument()
@options.parameter_argument("names", nargs=-1, required=True, metavar="NAME...")
@options.node_timeout
@options.as_json
@options.node_options
@verb
async def describe(network: NetworkOptions, node: str, names: tuple[str, ...], timeout_s: float, as_json: bool) -> int:
    """Print type, description and limits of parameters.

    \b
    rosidl-py param describe /talker rate use_sim_time
    """
    from rosidl_py_gen.ros_cli.param.remote import parameters_of, type_in_words

    async with parameters_of(network, node, timeout_s) as client:
        found = await client.describe(names, timeout_s)
    if as_json:
        terminal_output.document([{**asdict(one), "type": type_in_words(one.type)} for one in found])
    else:
        for one in found:
            terminal_output.lines(_lines(one))
    return 0


def _lines(one: ParameterDescriptor) -> list[str]:
    from rosidl_py_gen.ros_cli.param.remote import type_in_words

    lines = [f"Parameter name: {one.name}", f"  Type: {type_in_words(one.type)}"]
    if one.description:
        lines.append(f"  Description: {one.description}")
    lines.append("  Constraints:")
    if one.read_only:
        lines.append("    Read only: true")
    limits = one.floating_point_range or one.integer_range
    if limits is not None:
        lines += [f"    Min value: {limits.from_value}", f"    Max value: {limits.to_value}"]
        if limits.step:
            lines.append(f"    Step: {limits.step}")
    if one.additional_constraints:
        lines.append(f"    Additional constraints: {one.additional_constraints}")
    return lines
