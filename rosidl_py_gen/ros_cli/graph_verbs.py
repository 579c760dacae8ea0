"""Commands ``list``, ``find`` and ``type``, equal for topics, services and actions, and requests to many nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import click

from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.ros_cli import options

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.runtime import Node

    Option = Callable[[Any], Any]
    Rows = Callable[[Node], list[dict[str, Any]]]
T = TypeVar("T")


async def graph_rows(command_node: CommandNode, rows_of: Rows, *, hidden: bool, type_name: str = "") -> list[Any]:
    """Wait for discovery, and return rows about topics, services or actions of the graph.

    Args:
        rows_of: function of the node that returns rows with ``name`` and ``types``.
        hidden: include names with a part that begins with an underscore.
        type_name: include only names of this type.
    """
    await command_node.wait_for_discovery()
    command_node.note_if_alone()
    rows = [row for row in rows_of(command_node.node) if hidden or not command_node.is_hidden(row["name"])]
    return [row for row in rows if not type_name or type_name in row["types"]]


async def results_by_name(requests: dict[str, Coroutine[Any, Any, T]]) -> dict[str, T]:
    """Await requests to nodes concurrently; return results by node name. A failed request only prints a note."""
    import asyncio

    from rosidl_py_gen.errors import RosidlError

    results: dict[str, T] = {}
    outcomes = await asyncio.gather(*requests.values(), return_exceptions=True)
    for name, outcome in zip(requests, outcomes, strict=True):
        if isinstance(outcome, RosidlError):
            terminal_output.note(f"{name}: {outcome}")
        elif isinstance(outcome, BaseException):
            raise outcome
        else:
            results[name] = outcome
    return results


def list_verb(kind: str, examples: str, rows_of: Rows, *more: Option) -> Callable[..., None]:
    """Return the command ``list`` for services or actions (`kind`); `more` may add an option `hidden`."""

    async def list_(
        command_node: CommandNode, show_types: bool, count: bool, as_json: bool, hidden: bool = True
    ) -> None:
        terminal_output.names(await graph_rows(command_node, rows_of, hidden=hidden), count, show_types, as_json)

    list_.__doc__ = f"Print the {kind}s.\n\n\b\n{examples}"
    add = options.all_of(options.show_types, options.count(f"{kind}s"), *more, options.as_json)
    return click.command("list")(add(options.node_verb(list_)))


def find_verb(kind: str, definition: str, example: str, rows_of: Rows, *more: Option) -> Callable[..., None]:
    """Return the command ``find``, which prints the topics, services or actions (`kind`) of a type.

    Args:
        definition: ``msg``, ``srv`` or ``action``.
        rows_of: function of the node that returns rows with ``name`` and ``types``.
        more: further options, of which one may be `hidden`.
    """

    async def find(command_node: CommandNode, type_name: str, count: bool, as_json: bool, hidden: bool = True) -> None:
        name = str(RosName.parse(type_name, definition))
        rows = await graph_rows(command_node, rows_of, hidden=hidden, type_name=name)
        terminal_output.names(rows, count, False, as_json)

    find.__doc__ = f"Print the {kind}s of a type.\n\n\b\nrosidl-py {kind} find {example}"
    types = options.completion("types" if kind == "topic" else f"{kind} types")
    add = options.all_of(
        click.argument("type_name", metavar="TYPE", shell_complete=types),
        *(options.count(f"{kind}s"), *more, options.as_json),
    )
    return click.command("find")(add(options.node_verb(find)))


def type_verb(kind: str, example: str, *more: Option) -> Callable[..., None]:
    """Return the command ``type`` of a topic, service or action (`kind`); `more` may add an option `timeout_s`."""

    async def type_(command_node: CommandNode, as_json: bool, timeout_s: float | None = None, **name: str) -> None:
        full_name = await command_node.find(kind, name[kind], timeout_s)
        if kind == "topic":  # other publishers may have another type
            await command_node.wait_for_discovery()
        terminal_output.result(command_node.announced_types(kind, full_name), as_json)

    type_.__doc__ = f"Print the type of a{'n' if kind == 'action' else ''} {kind}.\n\n\b\n{example}"
    argument = click.argument(kind, shell_complete=options.completion(f"{kind}s"))
    return click.command("type")(options.all_of(argument, *more, options.as_json)(options.node_verb(type_)))
