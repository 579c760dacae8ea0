"""``param get`` and ``param describe``."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import ParameterDescriptor


@click.command("get")
@options.node_argument()
@options.parameter_argument()
@click.option("--hide-type", is_flag=True, help="Print only the value.")
@options.node_timeout
@options.as_json
@options.node_options
@verb
async def get(
    network: options.NetworkOptions, node: str, name: str, hide_type: bool, timeout_s: float, as_json: bool
) -> int:
    """Print the value of a parameter.

    \b
    rosidl-py param get /talker use_sim_time
    rosidl-py param get /talker rate --hide-type
    """
    from rosidl_py_gen.ros_cli.param.parameter_access import parameters_of, plain_parameter
    from rosidl_py_gen.runtime import parameter_value

    async with parameters_of(network, node, timeout_s) as client:
        value = await client.get(name, timeout_s)
        # The type of an empty list is unknown here.
        kind = await client.get_types(name, timeout_s) if value == () else parameter_value(value).type
    plain = plain_parameter(value)
    if as_json:
        terminal_output.document(plain)
    elif hide_type:
        terminal_output.block(str(plain))
    elif value is None:
        terminal_output.line("Parameter not set.")
    else:
        word = kind.name.removesuffix("_ARRAY").capitalize().replace("Bool", "Boolean")
        terminal_output.block(f"{word} {'values are' if kind.is_array else 'value is'}: {plain}")
    return 0


@click.command("describe")
@options.node_argument()
@options.parameter_argument("names", nargs=-1, required=True, metavar="NAME...")
@options.node_timeout
@options.as_json
@options.node_options
@verb
async def describe(
    network: options.NetworkOptions, node: str, names: tuple[str, ...], timeout_s: float, as_json: bool
) -> int:
    """Print type, description and limits of parameters.

    \b
    rosidl-py param describe /talker rate use_sim_time
    """
    from rosidl_py_gen.ros_cli.param.parameter_access import parameters_of, type_text

    async with parameters_of(network, node, timeout_s) as client:
        descriptors = await client.describe(names, timeout_s)
    if as_json:
        terminal_output.document([{**asdict(one), "type": type_text(one.type)} for one in descriptors])
    else:
        for descriptor in descriptors:
            terminal_output.lines(_description(descriptor))
    return 0


def _description(descriptor: ParameterDescriptor) -> list[str]:
    from rosidl_py_gen.ros_cli.param.parameter_access import type_text

    lines = [f"Parameter name: {descriptor.name}", f"  Type: {type_text(descriptor.type)}"]
    if descriptor.description:
        lines.append(f"  Description: {descriptor.description}")
    lines.append("  Constraints:")
    if descriptor.read_only:
        lines.append("    Read only: true")
    if limits := descriptor.floating_point_range or descriptor.integer_range:
        lines += [f"    Min value: {limits.from_value}", f"    Max value: {limits.to_value}"]
        if limits.step:
            lines.append(f"    Step: {limits.step}")
    if descriptor.additional_constraints:
        lines.append(f"    Additional constraints: {descriptor.additional_constraints}")
    return lines
