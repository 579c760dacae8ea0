"""``rosidl-py node``."""

from typing import Any

import click

from rosidl_py_gen.tools import options, run_command


@click.group(no_args_is_help=True)
def node() -> None:
    """Nodes: list, info."""


@node.command("list")
@click.option("-a", "--all", "hidden", is_flag=True, help="Show hidden ones, which begin with _, too.")
@click.option("-c", "--count-nodes", "count", is_flag=True, help="Print only how many there are.")
@options.as_json
@options.node_options
def list_(**arguments: Any) -> None:
    """Print the nodes there are.

    \b
    rosidl-py node list
    rosidl-py node list --json | jq -r '.[].name'
    """
    run_command("node.list", **arguments)


@node.command()
@options.node_argument()
@click.option("-a", "--include-hidden", "hidden", is_flag=True, help="Show hidden topics, services and actions, too.")
@options.as_json
@options.node_options
def info(**arguments: Any) -> None:
    """Print what a node subscribes to, publishes and serves.

    \b
    rosidl-py node info /talker
    """
    run_command("node.info", **arguments)
