"""Command group ``rosidl-py tf``."""

from rosidl_py_gen.ros_cli.groups import LazyGroup

tf = LazyGroup(
    "tf",
    package=__name__,
    help="Transforms: frames as a tree, one transform, rates and delays.",
    verbs={
        "echo": ("echo", "Print the transform from SOURCE to TARGET repeatedly."),
        "monitor": ("monitor", "Print once a second the rate and the delay of the transform of each frame."),
        "tree": ("tree", "Show the parent of each frame."),
    },
)
