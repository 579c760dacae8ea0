"""``lifecycle get``.

Decides, as `param list`, that all nodes are asked at once, and that one that never answers holds up no other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import AsyncCommand, options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.msgs.lifecycle_msgs.msg import State
    from rosidl_py_gen.ros_cli.command_node import NetworkOptions


@click.command("get")
@options.node_argument(required=False)
@click.option("-a", "--include-hidden-nodes", "hidden", is_flag=True, help="Ask hidden nodes, too.")
@options.node_timeout
@options.as_json
@options.node_options
@verb
def get(network: NetworkOptions, node: str | None, hidden: bool, timeout_s: float, as_json: bool) -> AsyncCommand:
    """Print the state of a node, or of all lifecycle nodes, which are asked at once.

    \b
    rosidl-py lifecycle get
    rosidl-py lifecycle get /camera
    """
    if node:
        return AsyncCommand(_of_one(network, node, timeout_s, as_json))
    return AsyncCommand(_of_all(network, hidden, timeout_s, as_json))


async def _of_one(network: NetworkOptions, node: str, timeout_s: float, as_json: bool) -> int:
    from rosidl_py_gen.ros_cli.lifecycle.remote import lifecycle_of

    async with lifecycle_of(network, node, timeout_s) as remote:
        state = await remote.state()
    if as_json:
        terminal_output.document(_plain(state))
    else:
        terminal_output.line(f"{state.label} [{state.id}]")
    return 0


async def _of_all(network: NetworkOptions, hidden: bool, timeout_s: float, as_json: bool) -> int:
    import asyncio

    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.lifecycle.remote import RemoteLifecycle, lifecycle_nodes
    from rosidl_py_gen.runtime import RosidlError

    async with CommandNode(network) as session:
        await session.wait_for_discovery()
        names = lifecycle_nodes(session.node, hidden=hidden)
        asked = (RemoteLifecycle(session.node, name, timeout_s).state() for name in names)
        answers = await asyncio.gather(*asked, return_exceptions=True)
    states: dict[str, State] = {}
    for name, answer in zip(names, answers, strict=True):
        if isinstance(answer, RosidlError):
            terminal_output.note(f"{name}: {answer}")
        elif isinstance(answer, BaseException):
            raise answer
        else:
            states[name] = answer
    if as_json:
        terminal_output.document({name: _plain(state) for name, state in states.items()})
    else:
        for name, state in states.items():
            terminal_output.line(f"{name}: {state.label} [{state.id}]")
    return 1 if names and not states else 0


def _plain(state: State) -> dict[str, Any]:
    return {"id": state.id, "label": state.label}
