"""``param get``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from rosidl_py_gen.tools import options, printing, verb

if TYPE_CHECKING:
    from rosidl_py_gen.tools.session import Network


@click.command("get")
@options.node_argument()
@options.parameter_argument()
@click.option("--hide-type", is_flag=True, help="Print the value alone.")
@options.node_timeout
@options.as_json
@options.node_options
@verb
async def get(network: Network, node: str, name: str, hide_type: bool, timeout_s: float, as_json: bool) -> int:
    """Print the value of a parameter.

    \b
    rosidl-py param get /talker use_sim_time
    rosidl-py param get /talker rate --hide-type
    """
    from rosidl_py_gen.runtime import parameter_value
    from rosidl_py_gen.tools.param.remote import parameters_of

    async with parameters_of(network, node, timeout_s) as client:
        value = await client.get(name, timeout_s)
        # An empty list does not tell its type.
        kind = await client.types(name, timeout_s) if value == () else parameter_value(value).type
    shown = list(value) if isinstance(value, tuple | bytes) else value
    if as_json:
        printing.document(shown)
    elif hide_type:
        printing.block(str(shown))
    elif value is None:
        printing.line("Parameter not set.")
    else:
        word = kind.name.removesuffix("_ARRAY").capitalize().replace("Bool", "Boolean")
        printing.block(f"{word} {'values are' if kind.is_array else 'value is'}: {shown}")
    return 0
