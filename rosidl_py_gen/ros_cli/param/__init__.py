"""``rosidl-py param``: a module for each command, or for several that do nearly the same."""

import click

from rosidl_py_gen.ros_cli.groups import LazyGroup


@click.group(
    cls=LazyGroup,
    package=__name__,
    verbs={
        "delete": ("set", "Delete a parameter, if the node lets us."),
        "describe": ("describe", "Print type, description and limits of parameters."),
        "dump": ("dump", "Print all parameters of a node as a parameter file."),
        "get": ("get", "Print the value of a parameter."),
        "list": ("list", "Print the parameters of a node, or of all nodes, which are asked at once."),
        "load": ("load", "Set what a parameter file says for a node."),
        "set": ("set", "Set a parameter."),
    },
)
def param() -> None:
    """Parameters: list, get, set, describe, dump, load, delete."""
