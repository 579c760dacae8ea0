"""Commands of ``rosidl-py lifecycle``, for nodes that serve ``~/get_state`` of the type in lifecycle_msgs."""

from __future__ import annotations

from contextlib import asynccontextmanager, closing
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.ros_cli import options

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.msgs.lifecycle_msgs import msg
    from rosidl_py_gen.runtime import Node

_IDENTIFYING_SERVICE = "/get_state"


class _LifecycleAccess(NamedTuple):
    """Access to the lifecycle services of the node `name`. Requests raise `CallTimeoutError` or `ServerLostError`."""

    node: Node
    name: str
    timeout_s: float

    async def call(self, cls: Any, service: str, **fields: Any) -> Any:
        with closing(self.node.create_client(cls, f"{self.name}/{service}")) as client:
            return await client.call(cls.Request(**fields), self.timeout_s)

    async def state(self) -> msg.State:
        from rosidl_py_gen.msgs.lifecycle_msgs import srv

        state: msg.State = (await self.call(srv.GetState, "get_state")).current_state
        return state


def _lifecycle_nodes(command_node: CommandNode, *, hidden: bool) -> list[str]:
    """Return the sorted full names of the lifecycle nodes in the graph."""
    return command_node.nodes_serving(_IDENTIFYING_SERVICE, "lifecycle_msgs/srv/GetState", hidden=hidden)


@asynccontextmanager
async def _access(command_node: CommandNode, node: str, timeout_s: float) -> AsyncIterator[_LifecycleAccess]:
    """Wait for a lifecycle node, and yield access to its services.

    Raises `CommandError` if it is missing or does not respond.
    """
    from rosidl_py_gen.runtime import CallTimeoutError, ServerLostError

    name = await command_node.find("node", node, timeout_s)
    if not await command_node.wait_for(lambda: name in _lifecycle_nodes(command_node, hidden=True), timeout_s):
        raise CommandError(f"{name} is not a lifecycle node: it does not serve {name}{_IDENTIFYING_SERVICE}")
    try:
        yield _LifecycleAccess(command_node.node, name, timeout_s)
    except (CallTimeoutError, ServerLostError) as error:
        raise CommandError(f"node {name} does not reply: {error}") from None


@click.command("nodes")
@click.option("-a", "--all", "hidden", is_flag=True, help="Include hidden nodes, whose names begin with _.")
@options.count("nodes")
@options.as_json
@options.node_verb
async def nodes(command_node: CommandNode, hidden: bool, count: bool, as_json: bool) -> None:
    """Print the lifecycle nodes.

    \b
    rosidl-py lifecycle nodes
    """
    await command_node.wait_for_discovery()
    names = _lifecycle_nodes(command_node, hidden=hidden)
    command_node.note_if_alone()
    terminal_output.result([str(len(names))] if count else names, as_json, names)


@click.command("get")
@options.node_argument(required=False)
@click.option("-a", "--include-hidden-nodes", "hidden", is_flag=True, help="Include hidden nodes.")
@options.node_timeout
@options.as_json
@options.node_verb
async def get(command_node: CommandNode, node: str | None, hidden: bool, timeout_s: float, as_json: bool) -> int:
    """Print the state of a node, or of all lifecycle nodes.

    \b
    rosidl-py lifecycle get
    rosidl-py lifecycle get /camera
    """
    if node:
        async with _access(command_node, node, timeout_s) as remote:
            state = await remote.state()
        terminal_output.result([_text(state)], as_json, _row(state))
        return 0
    from rosidl_py_gen.ros_cli.graph_verbs import results_by_name

    await command_node.wait_for_discovery()
    names = _lifecycle_nodes(command_node, hidden=hidden)
    states = await results_by_name({one: _LifecycleAccess(command_node.node, one, timeout_s).state() for one in names})
    texts = [f"{name}: {_text(state)}" for name, state in states.items()]
    terminal_output.result(texts, as_json, {name: _row(state) for name, state in states.items()})
    return 1 if names and not states else 0


def _row(state: msg.State) -> dict[str, Any]:
    return {"id": state.id, "label": state.label}


def _text(state: Any) -> str:
    return f"{state.label} [{state.id}]"


@click.command("list")
@options.node_argument()
@click.option("-a", "--all", "every", is_flag=True, help="Include the transitions of all states.")
@options.node_timeout
@options.as_json
@options.node_verb
async def list_(command_node: CommandNode, node: str, every: bool, timeout_s: float, as_json: bool) -> None:
    """Print the transitions that are possible in the state of a node.

    \b
    rosidl-py lifecycle list /camera
    """
    from rosidl_py_gen import to_dict
    from rosidl_py_gen.msgs.lifecycle_msgs import srv

    service = "get_transition_graph" if every else "get_available_transitions"
    async with _access(command_node, node, timeout_s) as remote:
        transitions = (await remote.call(srv.GetAvailableTransitions, service)).available_transitions
    lines: list[str] = []
    for one in transitions:
        lines += (
            f"- {_text(one.transition)}",
            f"    Start: {one.start_state.label}",
            f"    Goal: {one.goal_state.label}",
        )
    terminal_output.result(lines, as_json, [*map(to_dict, transitions)])


@click.command("set")
@options.node_argument()
@click.argument("transition")
@options.node_timeout
@options.as_json
@options.node_verb
async def set_(command_node: CommandNode, node: str, transition: str, timeout_s: float, as_json: bool) -> int:
    """Change the state of a node. TRANSITION is a name or number that `lifecycle list` prints.

    \b
    rosidl-py lifecycle set /camera configure
    rosidl-py lifecycle set /camera 3
    """
    from rosidl_py_gen.msgs.lifecycle_msgs import srv

    async with _access(command_node, node, timeout_s) as remote:
        response = await remote.call(srv.GetAvailableTransitions, "get_available_transitions")
        possible = [one.transition for one in response.available_transitions]
        by_text = {**{str(one.id): one for one in possible}, **{one.label: one for one in possible}}
        if transition not in by_text:
            choices = ", ".join(map(_text, possible)) or "none"
            raise CommandError(f"{remote.name} cannot {transition!r} in its present state; possible now: {choices}")
        response = await remote.call(srv.ChangeState, "change_state", transition=by_text[transition])
    if not response.success and not as_json:
        raise CommandError("Transitioning failed")
    terminal_output.result(["Transitioning successful"], as_json, {"successful": bool(response.success)})
    return 0 if response.success else 1
