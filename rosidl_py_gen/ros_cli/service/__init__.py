"""Command group ``rosidl-py service``."""

from rosidl_py_gen.ros_cli.groups import LazyGroup

service = LazyGroup(
    "service",
    package=__name__,
    help="Services: list, find, type, info, call, echo.",
    verbs={
        "call": ("call", "Call a service."),
        "echo": ("echo", "Print requests and responses as they pass."),
        "find": ("list", "Print the services of a type."),
        "info": ("info", "Print the type of a service, and its numbers of clients and servers."),
        "list": ("list", "Print the services."),
        "type": ("info", "Print the type of a service."),
    },
)
