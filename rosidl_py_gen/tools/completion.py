"""Completion: the scripts of the shells come from click; names come from the live graph, within half a second."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

import click
from click.shell_completion import CompletionItem, get_completion_class

from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import Node

_PROGRAM, _VARIABLE = "rosidl-py", "_ROSIDL_PY_COMPLETE"


def run(shell: str) -> int:
    """Print the completion script of a shell."""
    from rosidl_py_gen.tools import root

    maker = get_completion_class(shell)
    assert maker is not None  # click offers these choices
    click.echo(maker(root(), {}, _PROGRAM, _VARIABLE).source())
    return 0


def complete_names(what: str, context: click.Context, incomplete: str) -> list[CompletionItem]:
    """Names that begin with what is typed; none when nothing can be asked, as a shell wants no error here."""
    with contextlib.suppress(RosidlError, OSError, TypeError, ValueError):
        return [CompletionItem(name) for name in _names(what, context) if name.startswith(incomplete)]
    return []


def _names(what: str, context: click.Context) -> list[str]:
    if what == "types":
        from rosidl_py_gen.tools.types import interface_names

        return interface_names(paths=context.params.get("paths") or ())
    import asyncio

    from rosidl_py_gen.tools.session import Session

    async def look() -> list[str]:
        async with Session(context.params.get("network", {})) as session:
            await session.settle()
            return _listed(what, session.node)

    return asyncio.run(look())


def _listed(what: str, node: Node) -> list[str]:
    services = [name for name, _ in node.get_service_names_and_types()]
    match what:
        case "topics":
            return [name for name, _ in node.get_topic_names_and_types()]
        case "services":
            return services
        case "actions":
            mark = "/_action/send_goal"
            return [name.removesuffix(mark) for name in services if name.endswith(mark)]
        case "nodes":
            return [name for name in node.get_node_names() if not name.rpartition("/")[2].startswith("_")]
    raise ValueError(what)
