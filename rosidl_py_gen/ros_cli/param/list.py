"""``param list``.

Decides that all nodes are asked at once, so that one that never answers holds up no other; it is named on standard
error, and the command ends with 1 only when nobody answered.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.ros_cli import AsyncCommand, ToolError, options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions
    from rosidl_py_gen.runtime import ParameterClient


@dataclass(frozen=True)
class _Wish:
    """What to list: of which names, and whether with types."""

    pattern: re.Pattern[str]
    prefixes: tuple[str, ...]
    show_types: bool
    timeout_s: float

    async def of(self, client: ParameterClient) -> dict[str, str]:
        """Type by name, sorted; the type is empty when it was not asked for."""
        from rosidl_py_gen.ros_cli.param.remote import type_in_words

        listing = await client.list(self.prefixes, timeout_s=self.timeout_s)
        names = [name for name in sorted(listing.names) if self.pattern.match(name)]
        if not self.show_types or not names:
            return dict.fromkeys(names, "")
        described = await client.describe(names, self.timeout_s)
        return {name: type_in_words(one.type) for name, one in zip(names, described, strict=True)}


@click.command("list")
@options.node_argument(required=False)
@click.option("--filter", "pattern", metavar="REGEX", help="Only those whose name begins with what REGEX matches.")
@click.option(
    "--param-prefixes",
    "prefixes",
    multiple=True,
    metavar="PREFIX",
    help="Only those below; may be given several times.",
)
@click.option("--param-type", "show_types", is_flag=True, help="Show the types.")
@click.option("-a", "--include-hidden-nodes", "hidden", is_flag=True, help="Ask hidden nodes, too.")
@options.node_timeout
@options.as_json
@options.node_options
@verb
def list_(
    network: NetworkOptions,
    node: str | None,
    pattern: str | None,
    prefixes: tuple[str, ...],
    show_types: bool,
    hidden: bool,
    timeout_s: float,
    as_json: bool,
) -> AsyncCommand:
    """Print the parameters of a node, or of all nodes, which are asked at once.

    \b
    rosidl-py param list
    rosidl-py param list /talker --param-type
    rosidl-py param list --filter '.*rate'
    """
    try:
        compiled = re.compile(pattern or "")
    except re.error as error:
        raise ToolError(f"--filter {pattern!r} is no regular expression: {error}") from None
    wish = _Wish(compiled, prefixes, show_types, timeout_s)
    return AsyncCommand(_of_one(network, node, wish, as_json) if node else _of_all(network, hidden, wish, as_json))


async def _of_one(network: NetworkOptions, node: str, wish: _Wish, as_json: bool) -> int:
    from rosidl_py_gen.ros_cli.param.remote import parameters_of

    async with parameters_of(network, node, wish.timeout_s) as client:
        _show({client.node: await wish.of(client)}, as_json, headings=False)
    return 0


async def _of_all(network: NetworkOptions, hidden: bool, wish: _Wish, as_json: bool) -> int:
    import asyncio

    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.name_lookup import LIST_PARAMETERS, nodes_serving
    from rosidl_py_gen.runtime import RosidlError

    async with CommandNode(network) as session:
        await session.wait_for_discovery()
        nodes = nodes_serving(session.node, *LIST_PARAMETERS, hidden=hidden)
        session.note_if_alone()
        clients = [session.node.create_parameter_client(name) for name in nodes]
        answers = await asyncio.gather(*(wish.of(client) for client in clients), return_exceptions=True)
    found: dict[str, dict[str, str]] = {}
    for name, answer in zip(nodes, answers, strict=True):
        if isinstance(answer, dict):
            found[name] = answer
        elif isinstance(answer, RosidlError):
            terminal_output.note(f"{name}: {answer}")
        else:
            raise answer
    _show(found, as_json, headings=True)
    return 1 if nodes and not found else 0


def _show(found: dict[str, dict[str, str]], as_json: bool, *, headings: bool) -> None:
    if as_json:
        terminal_output.document(
            {
                node: [{"name": name, **({"type": kind} if kind else {})} for name, kind in names.items()]
                for node, names in found.items()
            }
        )
        return
    for node, names in found.items():
        if headings and names:
            terminal_output.line(f"{node}:", "bold cyan")
        for name, kind in names.items():
            terminal_output.line(f"  {name} (type: {kind})" if kind else f"  {name}")
