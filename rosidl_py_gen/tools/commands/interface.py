"""``rosidl-py interface``."""

from collections.abc import Callable
from typing import Any

import click

from rosidl_py_gen.tools import options, run_command

_TYPE = click.argument("name", metavar="TYPE", shell_complete=options.completion("interfaces"))
_PACKAGE = options.completion("packages")


def _kind_options(command: Callable[..., Any]) -> Callable[..., Any]:
    for short, kind, what in (("-a", "actions", "actions"), ("-s", "srvs", "services"), ("-m", "msgs", "messages")):
        command = click.option(short, f"--only-{kind}", kind, is_flag=True, help=f"Show the {what}.")(command)
    return command


@click.group(no_args_is_help=True)
def interface() -> None:
    """Definitions of messages, services and actions: those bundled, of AMENT_PREFIX_PATH and of --path."""


@interface.command("list")
@click.argument("package", required=False, shell_complete=_PACKAGE)
@_kind_options
@options.paths
@options.as_json
def list_(**arguments: Any) -> None:
    """Print the interfaces there are, all or those of a package.

    \b
    rosidl-py interface list -s
    rosidl-py interface list --path ~/robot_ws/src my_msgs
    """
    run_command("interface", command="list", **arguments)


@interface.command()
@_TYPE
@click.option("--no-comments", is_flag=True, help="Leave comments and empty lines out.")
@click.option("--all-comments", is_flag=True, help="Show the comments of nested types, too.")
@options.paths
@options.as_json
def show(**arguments: Any) -> None:
    """Print a definition, and below its fields the definitions of their types.

    TYPE is package/msg/Name, package/Name, a name that is in one package only, or - for standard input.

    \b
    rosidl-py interface show geometry_msgs/msg/PoseStamped
    rosidl-py topic type /scan | rosidl-py interface show -

    --json prints the type description and the hash.
    """
    run_command("interface", command="show", **arguments)


@interface.command()
@_TYPE
@click.option("--no-quotes", is_flag=True, help="Print YAML that is no single word of a shell.")
@options.paths
@options.as_json
def proto(**arguments: Any) -> None:
    """Print a message with all its fields as YAML, to be filled in; of a service its request, of an action its goal.

    \b
    rosidl-py interface proto geometry_msgs/msg/Twist
    rosidl-py topic pub --once /cmd_vel geometry_msgs/msg/Twist "$(rosidl-py interface proto --no-quotes Twist)"
    """
    run_command("interface", command="proto", **arguments)


@interface.command()
@click.argument("package", shell_complete=_PACKAGE)
@_kind_options
@options.paths
@options.as_json
def package(**arguments: Any) -> None:
    """Print the interfaces of a package, one a line.

    \b
    rosidl-py interface package std_srvs
    """
    run_command("interface", command="package", **arguments)


@interface.command()
@_kind_options
@options.paths
@options.as_json
def packages(**arguments: Any) -> None:
    """Print the packages that have interfaces.

    \b
    rosidl-py interface packages -a
    """
    run_command("interface", command="packages", **arguments)


@interface.command("hash")
@click.argument("names", metavar="TYPE...", nargs=-1, required=True, shell_complete=options.completion("interfaces"))
@click.option("--parts", is_flag=True, help="Also of the parts of services and actions.")
@options.paths
@options.as_json
def hash_(**arguments: Any) -> None:
    """Print the RIHS01 hash by which ROS nodes know whether they mean the same type.

    \b
    rosidl-py interface hash std_msgs/msg/String
    rosidl-py interface hash --parts example_interfaces/action/Fibonacci
    """
    run_command("interface", command="hash", **arguments)
