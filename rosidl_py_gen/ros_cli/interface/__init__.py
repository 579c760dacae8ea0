"""Command group ``rosidl-py interface``; its verbs are imported when called."""

from rosidl_py_gen.ros_cli.groups import LazyGroup

interface = LazyGroup(
    "interface",
    package=__name__,
    help="Definitions of messages, services and actions: those bundled, of AMENT_PREFIX_PATH and of --path.",
    verbs={
        "hash": ("hash", "Print the RIHS01 hash, which nodes compare to know if they use the same definition."),
        "list": ("list", "Print the available interfaces, all or those of a package."),
        "package": ("list", "Print the interfaces of a package, one per line."),
        "packages": ("list", "Print the packages that have interfaces."),
        "proto": ("proto", "Print a message with all its fields as YAML."),
        "show": ("show", "Print a definition, and below its fields the definitions of their types."),
    },
)
