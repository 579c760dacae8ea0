"""Command group ``rosidl-py action``."""

from rosidl_py_gen.ros_cli.groups import LazyGroup

action = LazyGroup(
    "action",
    package=__name__,
    help="Actions: list, find, type, info, send_goal.",
    verbs={
        "find": ("list", "Print the actions of a type."),
        "info": ("info", "Print the nodes with a server or a client of an action."),
        "list": ("list", "Print the actions."),
        "send_goal": ("goal", "Send a goal and wait for its result."),
        "type": ("info", "Print the type of an action."),
    },
)
