"""``param list``: requests go to all nodes at once, so a node that does not reply delays no other."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.ros_cli import AsyncCommand, CommandError, options, terminal_output, verb

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine
    from typing import Any, TypeAlias

    from rosidl_py_gen.runtime import ParameterClient

    _ListParameters: TypeAlias = Callable[[ParameterClient], Coroutine[Any, Any, dict[str, str]]]


@click.command("list")
@options.node_argument(required=False)
@click.option("--filter", "pattern", metavar="REGEX", help="Only parameters with a name whose beginning matches REGEX.")
@click.option(
    "--param-prefixes",
    "prefixes",
    multiple=True,
    metavar="PREFIX",
    help="Only parameters below PREFIX. May be repeated.",
)
@click.option("--param-type", "show_types", is_flag=True, help="Show the types.")
@click.option("-a", "--include-hidden-nodes", "hidden", is_flag=True, help="Include hidden nodes.")
@options.node_timeout
@options.as_json
@options.node_options
@verb
def list_(
    network: options.NetworkOptions,
    node: str | None,
    pattern: str | None,
    prefixes: tuple[str, ...],
    show_types: bool,
    hidden: bool,
    timeout_s: float,
    as_json: bool,
) -> AsyncCommand:
    """Print the parameters of a node, or of all nodes.

    \b
    rosidl-py param list
    rosidl-py param list /talker --param-type
    rosidl-py param list --filter '.*rate'
    """
    try:
        regex = re.compile(pattern or "")
    except re.error as error:
        raise CommandError(f"--filter {pattern!r} is not a regular expression: {error}") from None

    async def list_parameters(client: ParameterClient) -> dict[str, str]:
        """Return sorted names with types; types are empty unless they are shown."""
        from rosidl_py_gen.ros_cli.param.parameter_access import type_text

        listing = await client.list(prefixes, timeout_s=timeout_s)
        names = [name for name in sorted(listing.names) if regex.match(name)]
        if not show_types or not names:
            return dict.fromkeys(names, "")
        described = await client.describe(names, timeout_s)
        return {name: type_text(one.type) for name, one in zip(names, described, strict=True)}

    if node:
        return AsyncCommand(_list_one(network, node, timeout_s, list_parameters, as_json))
    return AsyncCommand(_list_all(network, hidden, list_parameters, as_json))


async def _list_one(
    network: options.NetworkOptions, node: str, timeout_s: float, list_parameters: _ListParameters, as_json: bool
) -> int:
    from rosidl_py_gen.ros_cli.param.parameter_access import parameters_of

    async with parameters_of(network, node, timeout_s) as client:
        _print({client.node: await list_parameters(client)}, as_json, headings=False)
    return 0


async def _list_all(
    network: options.NetworkOptions, hidden: bool, list_parameters: _ListParameters, as_json: bool
) -> int:
    from rosidl_py_gen.ros_cli.command_node import CommandNode, results_by_name
    from rosidl_py_gen.ros_cli.name_lookup import LIST_PARAMETERS, nodes_serving

    async with CommandNode(network) as command_node:
        await command_node.wait_for_discovery()
        nodes = nodes_serving(command_node.node, *LIST_PARAMETERS, hidden=hidden)
        command_node.note_if_alone()
        create = command_node.node.create_parameter_client
        parameters = await results_by_name({name: list_parameters(create(name)) for name in nodes})
    _print(parameters, as_json, headings=True)
    return 1 if nodes and not parameters else 0


def _print(parameters: dict[str, dict[str, str]], as_json: bool, *, headings: bool) -> None:
    if as_json:
        terminal_output.document(
            {
                node: [{"name": name, **({"type": kind} if kind else {})} for name, kind in names.items()]
                for node, names in parameters.items()
            }
        )
        return
    for node, names in parameters.items():
        if headings and names:
            terminal_output.line(f"{node}:", "bold cyan")
        terminal_output.lines(f"  {name} (type: {kind})" if kind else f"  {name}" for name, kind in names.items())
