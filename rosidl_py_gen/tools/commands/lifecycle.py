"""``rosidl-py lifecycle``."""

from typing import Any

import click

from rosidl_py_gen.tools import options, run_command


@click.group(no_args_is_help=True)
def lifecycle() -> None:
    """Lifecycle nodes: list them, get and set their states, list their transitions."""


_timeout = options.timeout("Wait so long for the node, and for its answers.")


@lifecycle.command()
@click.option("-a", "--all", "hidden", is_flag=True, help="Show hidden ones, which begin with _, too.")
@click.option("-c", "--count-nodes", "count", is_flag=True, help="Print only how many there are.")
@options.as_json
@options.node_options
def nodes(**arguments: Any) -> None:
    """Print the lifecycle nodes there are.

    \b
    rosidl-py lifecycle nodes
    """
    run_command("lifecycle.nodes", **arguments)


@lifecycle.command()
@options.node_argument(required=False)
@click.option("-a", "--include-hidden-nodes", "hidden", is_flag=True, help="Ask hidden nodes, too.")
@_timeout
@options.as_json
@options.node_options
def get(**arguments: Any) -> None:
    """Print the state of a node, or of all lifecycle nodes, which are asked at once.

    \b
    rosidl-py lifecycle get
    rosidl-py lifecycle get /camera
    """
    run_command("lifecycle.get", **arguments)


@lifecycle.command("set")
@options.node_argument()
@click.argument("transition")
@_timeout
@options.as_json
@options.node_options
def set_(**arguments: Any) -> None:
    """Let a node change its state; TRANSITION is a name or a number that `list` shows.

    \b
    rosidl-py lifecycle set /camera configure
    rosidl-py lifecycle set /camera 3
    """
    run_command("lifecycle.set", **arguments)


@lifecycle.command("list")
@options.node_argument()
@click.option("-a", "--all", "show_all", is_flag=True, help="Show all transitions there are, in any state.")
@_timeout
@options.as_json
@options.node_options
def list_(**arguments: Any) -> None:
    """Print the transitions that are possible in the state a node has.

    \b
    rosidl-py lifecycle list /camera
    """
    run_command("lifecycle.list", **arguments)
