"""``rosidl-py graph``."""

from typing import Any

import click

from rosidl_py_gen.tools import options, run_command


@click.command()
@options.drawn("svg")
@click.option(
    "--node",
    "nodes",
    multiple=True,
    metavar="NAME",
    shell_complete=options.completion("nodes"),
    help="Only these nodes and what they are connected with; * stands for anything, may be given several times.",
)
@click.option(
    "--topic",
    "topics",
    multiple=True,
    metavar="NAME",
    shell_complete=options.completion("topics"),
    help="Only these topics, services or actions; as --node.",
)
@click.option("-a", "--all", "everything", is_flag=True, help="Show hidden names and what every node has, too.")
@options.node_options
def graph(**arguments: Any) -> None:
    """Show which nodes are connected through which topics, services and actions.

    Parameter services, /rosout and /parameter_events, which every node has, are left out.

    \b
    rosidl-py graph
    rosidl-py graph -o graph.svg
    rosidl-py graph --node '/camera*' --format mermaid
    """
    run_command("graph.show", **arguments)
