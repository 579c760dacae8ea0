"""Completion: the scripts of the shells come from click; names come from the live graph."""

from __future__ import annotations

import contextlib
import warnings
from typing import TYPE_CHECKING

import click
from click.shell_completion import CompletionItem, get_completion_class

from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from rosidl_py_gen.runtime import Node
    from rosidl_py_gen.tools.session import Network

_PROGRAM, _VARIABLE = "rosidl-py", "_ROSIDL_PY_COMPLETE"
_PATIENCE_S = 1.5
"""How long a node may take to list its parameters, unless ``--spin-time`` is longer."""


def run(shell: str) -> int:
    """Print the completion script of a shell."""
    from rosidl_py_gen.tools import root

    maker = get_completion_class(shell)
    assert maker is not None  # click offers these choices
    click.echo(maker(root(), {}, _PROGRAM, _VARIABLE).source())
    return 0


def complete_names(what: str, context: click.Context, incomplete: str) -> list[CompletionItem]:
    """Names that begin with what is typed; none when nothing can be asked, as a shell wants no error here.

    Hidden ones are offered when a hidden part is typed.
    """
    with contextlib.suppress(RosidlError, OSError, ImportError, TypeError, ValueError):
        return [
            CompletionItem(name)
            for name in _names(what, context)
            if name.startswith(incomplete) and name.isprintable() and ("/_" in incomplete or "/_" not in name)
        ]
    return []


def complete_bag_names(kind: str, context: click.Context, incomplete: str) -> list[CompletionItem]:
    """The topics, services or actions of the bags that were named, which begin with what is typed; else none."""
    with contextlib.suppress(RosidlError, OSError, ImportError, ValueError):
        from rosidl_py_gen.bags import BagReader
        from rosidl_py_gen.tools.names import owner

        names: set[str] = set()
        places = filter(None, (context.params.get("path"), *(context.params.get("inputs") or ())))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for place in places:
                with BagReader(place) as reader:
                    owners = (owner(one.name, one.type_name) for one in reader.topics.values())
                    names |= {one.name for one in owners if one.kind == kind}
        return [CompletionItem(name) for name in sorted(names) if name.startswith(incomplete) and name.isprintable()]
    return []


def _names(what: str, context: click.Context) -> list[str]:
    if what in ("types", "packages"):
        from rosidl_py_gen.tools.types import interface_names

        names = interface_names(paths=context.params.get("paths") or ())
        return names if what == "types" else sorted({name.partition("/")[0] for name in names})
    import asyncio

    from rosidl_py_gen.tools.session import Session

    network: Network = context.params.get("network", {})

    async def look() -> list[str]:
        async with Session(network) as session:
            if what == "parameters":
                patience_s = max(network.get("spin_time_s") or 0.0, _PATIENCE_S)
                return await _parameters(session.node, context.params["node"], patience_s)
            await session.wait_until_quiet()
            return _listed(what, session.node)

    return asyncio.run(look())


async def _parameters(node: Node, name: str, patience_s: float) -> list[str]:
    client = node.create_parameter_client(name if name.startswith("/") else f"/{name}")
    return list((await client.list(timeout_s=patience_s)).names)


def _listed(what: str, node: Node) -> list[str]:
    services = [name for name, _ in node.get_service_names_and_types()]
    match what:
        case "topics":
            return [name for name, _ in node.get_topic_names_and_types() if "/_action/" not in name]
        case "services":
            return services
        case "actions":
            mark = "/_action/send_goal"
            return [name.removesuffix(mark) for name in services if name.endswith(mark)]
        case "nodes":
            return node.get_node_names()
    raise ValueError(what)
