"""Command group ``rosidl-py node``."""

from rosidl_py_gen.ros_cli.groups import LazyGroup

node = LazyGroup(
    "node",
    package=__name__,
    help="Nodes: list, info.",
    verbs={
        "info": ("info", "Print the topics, services and actions of a node."),
        "list": ("list", "Print the nodes."),
    },
)
