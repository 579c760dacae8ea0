"""``param dump``."""

from __future__ import annotations

from pathlib import Path

from rosidl_py_gen.runtime import parse_parameter_file
from rosidl_py_gen.tools import printing
from rosidl_py_gen.tools.param.remote import parameters_of
from rosidl_py_gen.tools.session import Network


async def run(network: Network, node: str, output: str | None, timeout_s: float, as_json: bool) -> int:
    """What the command does."""
    async with parameters_of(network, node, timeout_s) as client:
        text = await client.dump_yaml(timeout_s)
    if output is not None:
        Path(output).write_text(text, encoding="utf-8")
        printing.note(f"wrote {output}")
    if as_json:
        printing.document(
            {
                entry.pattern: {
                    name: list(one.value) if isinstance(one.value, tuple | bytes) else one.value
                    for name, one in entry.values.items()
                }
                for entry in parse_parameter_file(text)
            }
        )
    elif output is None:
        printing.block(text.rstrip("\n"))
    return 0
