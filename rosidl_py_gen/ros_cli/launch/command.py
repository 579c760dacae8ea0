"""``rosidl-py launch``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import options

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem


def _complete_words(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    completion = import_module("rosidl_py_gen.ros_cli.completion")
    return completion.complete_launch_words(context, incomplete)  # type: ignore[no-any-return]


@click.command("launch", no_args_is_help=True)
@click.option("-s", "--show-args", "--show-arguments", is_flag=True, help="Print the arguments of the launch file.")
@click.option(
    *("-p", "--print", "--print-description", "print_description"),
    is_flag=True,
    help="Print the actions of the launch file without running it.",
)
@click.option("-d", "--debug", is_flag=True, help="Print debug messages of launch.")
@click.option(
    *("-n", "--noninteractive"),
    is_flag=True,
    help="Send SIGINT to all processes on Ctrl-C; the default if standard input is not a terminal.",
)
@click.option(
    "-a", "--show-all-subprocesses-output", "show_all", is_flag=True, help="Print the output of all processes."
)
@click.option("--launch-prefix", metavar="COMMAND", help='Command before each executable, such as "gdb --args".')
@click.option("--launch-prefix-filter", metavar="REGEX", help="Executables that --launch-prefix applies to.")
@click.option(
    "--missing",
    type=click.Choice(["error", "skip"]),
    default="error",
    show_default=True,
    help="Packages and executables that do not exist: end with an error, or report each once and start the rest.",
)
@click.option(
    "--launch-from",
    "checkouts",
    multiple=True,
    metavar="DIR",
    help="Folder with checkouts of ros2/launch and ros2/launch_ros, if these are not installed. May be repeated.",
)
@options.paths
@click.argument("words", nargs=-1, metavar="(FILE | PACKAGE FILE) [NAME:=VALUE]...", shell_complete=_complete_words)
def launch(words: Sequence[str], paths: Sequence[str], checkouts: Sequence[str], **settings: Any) -> Callable[[], None]:
    """Run a launch file (Python, XML or YAML) with launch and launch_ros, and all its nodes on this package.

    PACKAGE is a package of the workspace, which needs no build, or of AMENT_PREFIX_PATH.

    \b
    rosidl-py launch my_robot robot.launch.py use_sim_time:=true
    rosidl-py launch src/my_robot/launch/robot.launch.py --missing skip
    """
    from rosidl_py_gen.ros_cli.launch.start import start

    if settings["show_args"] and settings["print_description"]:
        raise click.UsageError("--show-args and --print-description exclude each other")
    if settings["launch_prefix_filter"] and not settings["launch_prefix"]:
        raise click.UsageError("--launch-prefix-filter requires --launch-prefix")
    return start(words, paths, checkouts, settings)
