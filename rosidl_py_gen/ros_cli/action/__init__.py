"""``rosidl-py action``: a module for each command, or for several that do nearly the same."""

import click

from rosidl_py_gen.ros_cli.groups import LazyGroup


@click.group(
    cls=LazyGroup,
    package=__name__,
    verbs={
        "find": ("list", "Print the actions of a type."),
        "info": ("info", "Print which nodes serve an action, and which have clients of it."),
        "list": ("list", "Print the actions there are."),
        "send_goal": ("goal", "Send a goal and wait for its result."),
        "type": ("info", "Print the type of an action."),
    },
)
def action() -> None:
    """Actions: list, find, type, info, send_goal."""
