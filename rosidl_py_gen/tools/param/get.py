"""``param get``."""

from __future__ import annotations

from typing import Any

from rosidl_py_gen.runtime import parameter_value
from rosidl_py_gen.tools import Job, printing
from rosidl_py_gen.tools.param.remote import parameters_of
from rosidl_py_gen.tools.session import Network


def run(network: Network, **arguments: Any) -> Job:
    """What the command does."""
    return Job(_get(network, **arguments))


async def _get(network: Network, node: str, name: str, hide_type: bool, timeout_s: float, as_json: bool) -> int:
    async with parameters_of(network, node, timeout_s) as client:
        value = await client.get(name, timeout_s)
    shown = list(value) if isinstance(value, tuple | bytes) else value
    kind = parameter_value(value).type
    if as_json:
        printing.document(shown)
    elif hide_type:
        printing.line(str(shown))
    elif value is None:
        printing.line("Parameter not set.")
    else:
        word = kind.name.removesuffix("_ARRAY").capitalize().replace("Bool", "Boolean")
        printing.line(f"{word} {'values are' if kind.is_array else 'value is'}: {shown}")
    return 0
