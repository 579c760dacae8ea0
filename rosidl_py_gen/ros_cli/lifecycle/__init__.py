"""Command group ``rosidl-py lifecycle``."""

from rosidl_py_gen.ros_cli.groups import LazyGroup

lifecycle = LazyGroup(
    "lifecycle",
    package=__name__,
    help="Lifecycle nodes: list them, get and set their states, list their transitions.",
    verbs={
        "get": ("states", "Print the state of a node, or of all lifecycle nodes."),
        "list": ("states", "Print the transitions that are possible in the state of a node."),
        "nodes": ("states", "Print the lifecycle nodes."),
        "set": ("states", "Change the state of a node."),
    },
)
