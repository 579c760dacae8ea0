"""Command ``rosidl-py launch`` and its options."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import click

from rosidl_py_gen.ros_cli import exit_on_error, options

_NONINTERACTIVE = "Send SIGINT to all processes on Ctrl-C; the default if standard input is not a terminal."
_MISSING = "Packages and executables that do not exist: end with an error, or report each once and start the rest."
_FROM = "Folder with clones of ros2/launch and ros2/launch_ros, if these are not installed. May be repeated."
_INSTALL = (
    "Install launch and launch_ros of the distribution, or the named packages such as nav2_common, into this Python "
    "environment: from GitHub, or from the clones of --launch-from."
)
_WORDS = "(FILE | PACKAGE FILE) [NAME:=VALUE]..."
_flag = partial(click.option, is_flag=True)


@click.command("launch", no_args_is_help=True)
@_flag("-s", "--show-args", "--show-arguments", help="Print the arguments of the launch file.")
@_flag("-p", "--print", "--print-description", help="Print the actions of the launch file without running it.")
@_flag("-d", "--debug", help="Print debug messages of launch.")
@_flag("-n", "--noninteractive", help=_NONINTERACTIVE)
@_flag("-a", "--show-all-subprocesses-output", "show_all", help="Print the output of all processes.")
@click.option("--launch-prefix", metavar="COMMAND", help='Command before each executable, such as "gdb --args".')
@click.option("--launch-prefix-filter", metavar="REGEX", help="Executables that --launch-prefix applies to.")
@click.option("--missing", type=click.Choice(["error", "skip"]), default="error", show_default=True, help=_MISSING)
@click.option("--launch-from", "checkouts", multiple=True, metavar="DIR", help=_FROM)
@_flag("--install", "installs", help=_INSTALL)
@options.paths
@click.argument("words", nargs=-1, metavar=_WORDS, shell_complete=options.launch_completion)
def launch(
    words: Sequence[str], paths: Sequence[str], checkouts: Sequence[str], installs: bool, **settings: Any
) -> Callable[[], None] | None:
    """Run a launch file (Python, XML or YAML) with launch and launch_ros, and all its nodes on this package.

    PACKAGE is a package of the workspace, which needs no build, or of AMENT_PREFIX_PATH.

    \b
    rosidl-py launch --install
    rosidl-py launch --install nav2_common nav2_simple_commander
    rosidl-py launch my_robot robot.launch.py use_sim_time:=true
    rosidl-py launch src/my_robot/launch/robot.launch.py --missing skip
    """
    if installs:
        if paths or any(value for name, value in settings.items() if name != "missing"):
            raise click.UsageError("--install takes names of packages, --launch-from and --distro; no other options")
        from rosidl_py_gen.prefix import install_ros_packages

        install_ros_packages(words, checkouts)
        return None
    if not words:
        raise click.UsageError(f"expected {_WORDS}, or --install")
    from rosidl_py_gen.prefix import is_launch_file, start_launch

    if settings["show_args"] and settings["print"]:
        raise click.UsageError("--show-args and --print-description exclude each other")
    if settings["launch_prefix_filter"] and not settings["launch_prefix"]:
        raise click.UsageError("--launch-prefix-filter requires --launch-prefix")
    for word in words[1 if is_launch_file(words[0]) else 2 :]:
        name, mark, _ = word.partition(":=")
        if not (name and mark):
            raise click.UsageError(f'expected NAME:=VALUE, found "{word}"')
    return exit_on_error()(start_launch(words, paths, checkouts, settings))
