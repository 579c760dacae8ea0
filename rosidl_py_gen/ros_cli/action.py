"""Commands of ``rosidl-py action``: list, find, type, info and send_goal.

Before ``send_goal`` has sent the goal, Ctrl-C ends the command. Afterwards Ctrl-C cancels the goal, as soon as the
server has accepted the goal.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.ros_cli import options
from rosidl_py_gen.ros_cli.graph_verbs import find_verb, list_verb, type_verb

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.runtime import ActionClient, ClientGoal, GoalStatus, Node


def _actions(node: Node) -> list[dict[str, Any]]:
    from rosidl_py_gen.command_support import CommandNode

    return [{"name": name, "types": types} for name, types in CommandNode.actions(node.get_topic_names_and_types())]


list_ = list_verb("action", "rosidl-py action list -t", _actions)
find = find_verb("action", "action", "example_interfaces/action/Fibonacci", _actions)
type_ = type_verb("action", "rosidl-py action type /fibonacci")


@click.command("info")
@options.action_argument()
@options.show_types
@click.option("-c", "--count", is_flag=True, help="Print only the numbers of clients and servers.")
@options.as_json
@options.node_verb
async def info(command_node: CommandNode, action: str, show_types: bool, count: bool, as_json: bool) -> None:
    """Print the nodes with a server or a client of an action.

    \b
    rosidl-py action info /fibonacci -t
    """
    node = command_node.node
    name = await command_node.find("action", action)
    await command_node.wait_for_node_names()
    types = dict(command_node.actions(node.get_topic_names_and_types())).get(name, [])
    clients = _nodes_with(name, node, node.get_subscriber_names_and_types_by_node)
    servers = _nodes_with(name, node, node.get_publisher_names_and_types_by_node)
    lines = [f"Action: {name}"]
    for kind, users in (("clients", clients), ("servers", servers)):
        lines.append(f"Action {kind}: {len(users)}")
        for user in () if count else users:
            lines.append(f"    {user['node']}" + (f" [{', '.join(user['types'])}]" if show_types else ""))
    terminal_output.result(lines, as_json, {"name": name, "types": types, "clients": clients, "servers": servers})


def _nodes_with(action: str, node: Node, topics_of: Callable[[str, str], Any]) -> list[dict[str, Any]]:
    """Return the nodes that have topics of an action, with the types of the action.

    The function `topics_of(name, namespace)` returns the topics of a node.
    """
    from rosidl_py_gen.command_support import CommandNode

    return [
        {"node": one.fully_qualified_name, "types": types}
        for one in sorted(node.get_nodes(), key=lambda known: known.fully_qualified_name)
        for name, types in CommandNode.actions(topics_of(one.name, one.namespace))
        if name == action
    ]


@click.command("send_goal")
@options.action_argument()
@click.argument("words", nargs=-1, metavar="[TYPE] [GOAL]", shell_complete=options.call_completion("action"))
@click.option("--stdin", is_flag=True, help="Read the goal from standard input.")
@click.option("-f", "--feedback", "show_feedback", is_flag=True, help="Print the feedback.")
@options.timeout("Maximum time to wait for the server and for each reply, except the result.", default_s=10)
@options.paths
@options.as_json
@options.node_verb
async def send_goal(
    command_node: CommandNode,
    action: str,
    words: tuple[str, ...],
    stdin: bool,
    show_feedback: bool,
    timeout_s: float,
    paths: tuple[str, ...],
    as_json: bool,
) -> int:
    """Send a goal and wait for its result. GOAL is YAML or JSON; omitted fields have their defaults.

    Ctrl-C cancels the goal; a second Ctrl-C does not wait for the reply. The exit code is 0 if the goal succeeded, 1 if
    it was rejected, aborted or canceled, 130 after Ctrl-C.

    \b
    rosidl-py action send_goal /fibonacci '{order: 5}' --feedback
    rosidl-py action send_goal /fibonacci example_interfaces/action/Fibonacci '{order: 5}' --json
    """
    from rosidl_py_gen.command_support import interface_class, preload_while_waiting
    from rosidl_py_gen.ros_cli import message_text
    from rosidl_py_gen.runtime import WaitTimeoutError

    type_name, text = message_text.type_and_values(words, stdin=stdin)
    show = _Printer(as_json)
    show.say("Waiting for an action server to become available...")
    name = await preload_while_waiting(command_node.find("action", action, timeout_s))
    cls: Any = await interface_class(command_node, "action", name, type_name, paths)
    goal = message_text.message_from(cls.Goal, text)
    client = command_node.node.create_action_client(cls, name)
    try:
        await client.wait_for_server(timeout_s)
    except WaitTimeoutError as error:
        raise CommandError(str(error)) from None
    show.message("Sending goal", goal)
    return await _follow(client, goal, show, show_feedback, timeout_s)


async def _follow(
    client: ActionClient[Any], goal: Message, show: _Printer, show_feedback: bool, timeout_s: float
) -> int:
    """Send a goal, print feedback and result, and return the exit code: 0 if the goal succeeded, 1 if not, 130 after
    Ctrl-C.
    """
    import asyncio

    from rosidl_py_gen.runtime import GoalRejectedError, GoalStatus

    sending = asyncio.ensure_future(client.send_goal(goal, timeout_s))
    try:
        handle = await asyncio.shield(sending)
        show.say(f"Goal accepted with ID: {handle.goal_id.hex()}")
        show.say("")
        if show_feedback:
            async for feedback in handle.feedback():
                show.feedback(feedback)
        status = await _end(handle, show)
    except GoalRejectedError:
        raise CommandError("Goal was rejected.") from None
    except asyncio.CancelledError:
        await _cancel(sending, show, timeout_s)
        return 130
    return 0 if status is GoalStatus.SUCCEEDED else 1


async def _end(handle: ClientGoal[Any], show: _Printer, timeout_s: float | None = None) -> GoalStatus:
    status, result = await handle.result(timeout_s)
    show.result(handle.goal_id, status, result)
    return status


async def _cancel(sending: asyncio.Task[ClientGoal[Any]], show: _Printer, timeout_s: float) -> None:
    """Wait until the task `sending` has sent the goal, cancel the goal, and wait for its end.

    Raises `CommandError` if the goal may still run.
    """
    from rosidl_py_gen.runtime import ActionTimeoutError, CancelError, GoalRejectedError

    terminal_output.note("Canceling goal...")
    with suppress(GoalRejectedError):
        try:
            handle = await sending
            try:
                await handle.cancel(timeout_s)
            except CancelError as error:
                terminal_output.note(str(error))
            await _end(handle, show, timeout_s)
        except ActionTimeoutError as error:
            raise CommandError(f"the goal may still be running: {error}") from None


class _Printer:
    """Printer of a goal's progress in the form of ``ros2 action send_goal``, or as a line of JSON for each feedback and
    the result.
    """

    def __init__(self, as_json: bool) -> None:
        self._as_json = as_json

    def say(self, text: str, style: str = "") -> None:
        """Print a line, unless the output is JSON."""
        if not self._as_json:
            terminal_output.line(text, style)

    def message(self, heading: str, message: Message) -> None:
        """Print a ROS message as YAML below a heading, unless the output is JSON."""
        from rosidl_py_gen.ros_cli import message_text

        if not self._as_json:
            text = message_text.to_yaml(message_text.to_plain(message)).rstrip("\n").replace("\n", "\n    ")
            terminal_output.block(f"{heading}:\n    {text}\n")

    def feedback(self, feedback: Message) -> None:
        """Print a feedback message."""
        from rosidl_py_gen import to_dict

        self.message("Feedback", feedback)
        if self._as_json:
            terminal_output.document({"feedback": to_dict(feedback)}, in_stream=True)

    def result(self, goal_id: bytes, status: GoalStatus, result: Message) -> None:
        """Print the result and the final status of the goal."""
        from rosidl_py_gen import to_dict
        from rosidl_py_gen.runtime import GoalStatus

        self.message("Result", result)
        self.say(f"Goal finished with status: {status.name}", "green" if status is GoalStatus.SUCCEEDED else "red")
        if self._as_json:
            row = {"goal_id": goal_id.hex(), "status": status.name, "result": to_dict(result)}
            terminal_output.document(row, in_stream=True)
