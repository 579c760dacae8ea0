"""``rosidl-py lifecycle``: a module for each command, or for several that do nearly the same."""

import click

from rosidl_py_gen.ros_cli.groups import LazyGroup


@click.group(
    cls=LazyGroup,
    package=__name__,
    verbs={
        "get": ("get", "Print the state of a node, or of all lifecycle nodes, which are asked at once."),
        "list": ("list", "Print the transitions that are possible in the state a node has."),
        "nodes": ("nodes", "Print the lifecycle nodes there are."),
        "set": ("set", "Change the state of a node."),
    },
)
def lifecycle() -> None:
    """Lifecycle nodes: list them, get and set their states, list their transitions."""
