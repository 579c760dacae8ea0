"""``lifecycle get``, ``list``, ``nodes`` and ``set``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import AsyncCommand, CommandError, options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.msgs.lifecycle_msgs.msg import State


@click.command("nodes")
@click.option("-a", "--all", "hidden", is_flag=True, help="Include hidden nodes, whose names begin with _.")
@options.count("nodes")
@options.as_json
@options.node_options
@verb
async def nodes(network: options.NetworkOptions, hidden: bool, count: bool, as_json: bool) -> int:
    """Print the lifecycle nodes.

    \b
    rosidl-py lifecycle nodes
    """
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.lifecycle.lifecycle_access import lifecycle_nodes

    async with CommandNode(network) as command_node:
        await command_node.wait_for_discovery()
        names = lifecycle_nodes(command_node.node, hidden=hidden)
        command_node.note_if_alone()
    terminal_output.values([str(len(names))] if count and not as_json else names, as_json)
    return 0


@click.command("get")
@options.node_argument(required=False)
@click.option("-a", "--include-hidden-nodes", "hidden", is_flag=True, help="Include hidden nodes.")
@options.node_timeout
@options.as_json
@options.node_options
@verb
def get(
    network: options.NetworkOptions, node: str | None, hidden: bool, timeout_s: float, as_json: bool
) -> AsyncCommand:
    """Print the state of a node, or of all lifecycle nodes.

    \b
    rosidl-py lifecycle get
    rosidl-py lifecycle get /camera
    """
    if node:
        return AsyncCommand(_print_state(network, node, timeout_s, as_json))
    return AsyncCommand(_print_all_states(network, hidden, timeout_s, as_json))


async def _print_state(network: options.NetworkOptions, node: str, timeout_s: float, as_json: bool) -> int:
    from rosidl_py_gen.ros_cli.lifecycle.lifecycle_access import lifecycle_of

    async with lifecycle_of(network, node, timeout_s) as remote:
        state = await remote.state()
    if as_json:
        terminal_output.document(_row(state))
    else:
        terminal_output.line(f"{state.label} [{state.id}]")
    return 0


async def _print_all_states(network: options.NetworkOptions, hidden: bool, timeout_s: float, as_json: bool) -> int:
    from rosidl_py_gen.ros_cli.command_node import CommandNode, results_by_name
    from rosidl_py_gen.ros_cli.lifecycle.lifecycle_access import LifecycleAccess, lifecycle_nodes

    async with CommandNode(network) as command_node:
        await command_node.wait_for_discovery()
        names = lifecycle_nodes(command_node.node, hidden=hidden)
        states = await results_by_name(
            {name: LifecycleAccess(command_node.node, name, timeout_s).state() for name in names}
        )
    if as_json:
        terminal_output.document({name: _row(state) for name, state in states.items()})
    else:
        terminal_output.lines(f"{name}: {state.label} [{state.id}]" for name, state in states.items())
    return 1 if names and not states else 0


def _row(state: State) -> dict[str, Any]:
    return {"id": state.id, "label": state.label}


@click.command("list")
@options.node_argument()
@click.option("-a", "--all", "every", is_flag=True, help="Include the transitions of all states.")
@options.node_timeout
@options.as_json
@options.node_options
@verb
async def list_(network: options.NetworkOptions, node: str, every: bool, timeout_s: float, as_json: bool) -> int:
    """Print the transitions that are possible in the state of a node.

    \b
    rosidl-py lifecycle list /camera
    """
    from rosidl_py_gen import to_dict
    from rosidl_py_gen.ros_cli.lifecycle.lifecycle_access import lifecycle_of

    async with lifecycle_of(network, node, timeout_s) as remote:
        transitions = await remote.transitions(every=every)
    if as_json:
        terminal_output.document([*map(to_dict, transitions)])
        return 0
    for one in transitions:
        transition = f"- {one.transition.label} [{one.transition.id}]"
        terminal_output.lines([transition, f"    Start: {one.start_state.label}", f"    Goal: {one.goal_state.label}"])
    return 0


@click.command("set")
@options.node_argument()
@click.argument("transition")
@options.node_timeout
@options.as_json
@options.node_options
@verb
async def set_(network: options.NetworkOptions, node: str, transition: str, timeout_s: float, as_json: bool) -> int:
    """Change the state of a node. TRANSITION is a name or number that `lifecycle list` prints.

    \b
    rosidl-py lifecycle set /camera configure
    rosidl-py lifecycle set /camera 3
    """
    from rosidl_py_gen.ros_cli.lifecycle.lifecycle_access import lifecycle_of

    async with lifecycle_of(network, node, timeout_s) as remote:
        possible = [one.transition for one in await remote.transitions()]
        by_text = {**{str(one.id): one for one in possible}, **{one.label: one for one in possible}}
        if transition not in by_text:
            choices = ", ".join(f"{one.label} [{one.id}]" for one in possible) or "none"
            raise CommandError(f"{remote.name} cannot {transition!r} in its present state; possible now: {choices}")
        successful = await remote.change(by_text[transition])
    if as_json:
        terminal_output.document({"successful": successful})
    elif not successful:
        raise CommandError("Transitioning failed")
    else:
        terminal_output.line("Transitioning successful")
    return 0 if successful else 1
