"""Command group ``rosidl-py param``."""

from rosidl_py_gen.ros_cli.groups import LazyGroup

param = LazyGroup(
    "param",
    package=__name__,
    help="Parameters: list, get, set, describe, dump, load, delete.",
    verbs={
        "delete": ("set", "Delete a parameter, if the node allows it."),
        "describe": ("get", "Print type, description and limits of parameters."),
        "dump": ("files", "Print all parameters of a node as a parameter file."),
        "get": ("get", "Print the value of a parameter."),
        "list": ("list", "Print the parameters of a node, or of all nodes."),
        "load": ("files", "Set the parameters of a node that a parameter file contains."),
        "set": ("set", "Set a parameter."),
    },
)
