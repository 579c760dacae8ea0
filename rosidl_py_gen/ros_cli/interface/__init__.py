"""``rosidl-py interface``: a module for each command, or for several that do nearly the same."""

import click

from rosidl_py_gen.ros_cli.groups import LazyGroup


@click.group(
    cls=LazyGroup,
    package=__name__,
    verbs={
        "hash": ("hash", "Print the RIHS01 hash by which ROS nodes know whether they mean the same type."),
        "list": ("list", "Print the interfaces there are, all or those of a package."),
        "package": ("list", "Print the interfaces of a package, one a line."),
        "packages": ("list", "Print the packages that have interfaces."),
        "proto": ("proto", "Print a message with all its fields as YAML, to be filled in."),
        "show": ("show", "Print a definition, and below its fields the definitions of their types."),
    },
)
def interface() -> None:
    """Definitions of messages, services and actions: those bundled, of AMENT_PREFIX_PATH and of --path."""
