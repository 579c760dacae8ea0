"""``rosidl-py node``: a module for each command, or for several that do nearly the same."""

import click

from rosidl_py_gen.ros_cli.groups import LazyGroup


@click.group(
    cls=LazyGroup,
    package=__name__,
    verbs={
        "info": ("info", "Print what a node subscribes to, publishes and serves."),
        "list": ("list", "Print the nodes there are."),
    },
)
def node() -> None:
    """Nodes: list, info."""
