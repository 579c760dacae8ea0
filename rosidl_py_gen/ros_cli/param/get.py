"""``param get``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions


@click.command("get")
@options.node_argument()
@options.parameter_argument()
@click.option("--hide-type", is_flag=True, help="Print the value alone.")
@options.node_timeout
@options.as_json
@options.node_options
@verb
async def get(network: NetworkOptions, node: str, name: str, hide_type: bool, timeout_s: float, as_json: bool) -> int:
    """Print the value of a parameter.

    \b
    rosidl-py param get /talker use_sim_time
    rosidl-py param get /talker rate --hide-type
    """
    from rosidl_py_gen.ros_cli.param.remote import parameters_of
    from rosidl_py_gen.runtime import parameter_value

    async with parameters_of(network, node, timeout_s) as client:
        value = await client.get(name, timeout_s)
        # An empty list does not tell its type.
        kind = await client.get_types(name, timeout_s) if value == () else parameter_value(value).type
    shown = list(value) if isinstance(value, tuple | bytes) else value
    if as_json:
        terminal_output.document(shown)
    elif hide_type:
        terminal_output.block(str(shown))
    elif value is None:
        terminal_output.line("Parameter not set.")
    else:
        word = kind.name.removesuffix("_ARRAY").capitalize().replace("Bool", "Boolean")
        terminal_output.block(f"{word} {'values are' if kind.is_array else 'value is'}: {shown}")
    return 0
