"""``param set`` and ``param delete``, which sets no value."""

from __future__ import annotations

from rosidl_py_gen.runtime import Parameter, ParameterValue, parse_parameter_value
from rosidl_py_gen.tools import ToolError, printing
from rosidl_py_gen.tools.param.remote import parameters_of
from rosidl_py_gen.tools.session import Network


async def run(network: Network, node: str, name: str, value: str | None, timeout_s: float, as_json: bool) -> int:
    """What the command does."""
    wanted = ParameterValue() if value is None else parse_parameter_value(value)
    async with parameters_of(network, node, timeout_s) as client:
        (result,) = await client.set([Parameter(name, wanted)], timeout_s)
    reason = f": {result.reason}" if result.reason else ""
    if as_json:
        printing.document({"successful": result.successful, "reason": result.reason})
    elif not result.successful:
        raise ToolError(f"{'Setting' if wanted.is_set else 'Deleting'} parameter failed{reason}")
    else:
        printing.line(f"{'Set parameter successful' if wanted.is_set else 'Deleted parameter successfully'}{reason}")
    return 0 if result.successful else 1
