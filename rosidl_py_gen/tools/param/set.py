"""``param set`` and ``param delete``, which sets no value."""

from __future__ import annotations

from typing import Any

from rosidl_py_gen.runtime import Parameter, ParameterValue, parse_parameter_value
from rosidl_py_gen.tools import Job, ToolError, printing
from rosidl_py_gen.tools.param.remote import parameters_of
from rosidl_py_gen.tools.session import Network


def run(network: Network, value: str | None, **arguments: Any) -> Job:
    """What the command does."""
    wanted = ParameterValue() if value is None else parse_parameter_value(value)
    return Job(_set(network, value=wanted, **arguments))


async def _set(network: Network, node: str, name: str, value: ParameterValue, timeout_s: float, as_json: bool) -> int:
    async with parameters_of(network, node, timeout_s) as client:
        (result,) = await client.set([Parameter(name, value)], timeout_s)
    reason = f": {result.reason}" if result.reason else ""
    if as_json:
        printing.document({"successful": result.successful, "reason": result.reason})
    elif not result.successful:
        raise ToolError(f"{'Setting' if value.is_set else 'Deleting'} parameter failed{reason}")
    else:
        printing.line(f"{'Set parameter successful' if value.is_set else 'Deleted parameter successfully'}{reason}")
    return 0 if result.successful else 1
