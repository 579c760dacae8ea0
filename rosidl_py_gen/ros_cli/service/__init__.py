"""``rosidl-py service``: a module for each command, or for several that do nearly the same."""

import click

from rosidl_py_gen.ros_cli.groups import LazyGroup


@click.group(
    cls=LazyGroup,
    package=__name__,
    verbs={
        "call": ("call", "Call a service."),
        "echo": (
            "echo",
            "Print requests and responses as they pass.",
        ),
        "find": ("list", "Print the services of a type."),
        "info": ("info", "Print the type of a service, and how many clients and servers it has."),
        "list": ("list", "Print the services there are."),
        "type": ("info", "Print the type of a service."),
    },
)
def service() -> None:
    """Services: list, find, type, info, call, echo."""
