"""``param get``."""

from __future__ import annotations

from rosidl_py_gen.runtime import parameter_value
from rosidl_py_gen.tools import printing
from rosidl_py_gen.tools.param.remote import parameters_of
from rosidl_py_gen.tools.session import Network


async def run(network: Network, node: str, name: str, hide_type: bool, timeout_s: float, as_json: bool) -> int:
    """What the command does."""
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
