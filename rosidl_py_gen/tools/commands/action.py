"""``rosidl-py action``."""

from typing import Any

import click

from rosidl_py_gen.tools import options, run_command


@click.group(no_args_is_help=True)
def action() -> None:
    """Actions: list, find, type, info, send_goal."""


_count = click.option("-c", "--count-actions", "count", is_flag=True, help="Print only how many there are.")


@action.command("list")
@click.option("-t", "--show-types", is_flag=True, help="Show the types.")
@_count
@options.as_json
@options.node_options
def list_(**arguments: Any) -> None:
    """Print the actions there are.

    \b
    rosidl-py action list -t
    """
    run_command("action.list", **arguments)


@action.command()
@click.argument("of_type", metavar="TYPE", shell_complete=options.completion("action types"))
@_count
@options.as_json
@options.node_options
def find(**arguments: Any) -> None:
    """Print the actions of a type.

    \b
    rosidl-py action find example_interfaces/action/Fibonacci
    """
    run_command("action.list", **arguments)


@action.command("type")
@options.action_argument()
@options.as_json
@options.node_options
def type_(**arguments: Any) -> None:
    """Print the type of an action.

    \b
    rosidl-py action type /fibonacci
    """
    run_command("action.info", only_type=True, **arguments)


@action.command()
@options.action_argument()
@click.option("-t", "--show-types", is_flag=True, help="Show the types.")
@click.option("-c", "--count", is_flag=True, help="Print only how many clients and servers there are.")
@options.as_json
@options.node_options
def info(**arguments: Any) -> None:
    """Print which nodes serve an action, and which have clients of it.

    \b
    rosidl-py action info /fibonacci -t
    """
    run_command("action.info", **arguments)


@action.command("send_goal")
@options.action_argument()
@click.argument("words", nargs=-1, metavar="[TYPE] [GOAL]", shell_complete=options.call_completion("action"))
@click.option("--stdin", is_flag=True, help="Read the goal from standard input.")
@click.option("-f", "--feedback", "show_feedback", is_flag=True, help="Print the feedback.")
@options.timeout("Wait so long for the server and its answers; the result is waited for without a limit.", default_s=10)
@options.paths
@options.as_json
@options.node_options
def send_goal(**arguments: Any) -> None:
    """Send a goal and wait for its result; GOAL is YAML or JSON, what it leaves out has its default.

    Ctrl-C cancels the goal, and again does not wait for the answer. The exit code is 0 when the goal succeeded, 1 when
    it was rejected, aborted or canceled, 130 after Ctrl-C.

    \b
    rosidl-py action send_goal /fibonacci '{order: 5}' --feedback
    rosidl-py action send_goal /fibonacci example_interfaces/action/Fibonacci '{order: 5}' --json
    """
    run_command("action.goal", **arguments)
