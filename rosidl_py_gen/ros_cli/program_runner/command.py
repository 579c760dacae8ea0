"""``rosidl-py run``."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import click

from rosidl_py_gen.ros_cli import options

_OPTIONS = {
    "--path": True,
    "--distro": True,
    "--check": False,
    "--list": False,
    "--json": False,
    "-h": False,
    "--help": False,
}
"""Options before the program, and True for those with a value."""


class _Program(click.Command):
    """Command that passes all words after the program to it, as python does."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        index = 0
        while index < len(args) and args[index].partition("=")[0] in _OPTIONS:
            index += 2 if _OPTIONS[args[index].partition("=")[0]] and "=" not in args[index] else 1
        if index >= len(args) or args[index] == "-m" or not args[index].startswith("-"):
            args = [*args[:index], "--", *args[index:]]
        return super().parse_args(ctx, args)


@click.command("run", cls=_Program, no_args_is_help=True)
@click.option("--check", is_flag=True, help="Print missing names and packages instead of running the program.")
@click.option("--list", "listed", is_flag=True, help="Print the executables of PACKAGE, or of all packages.")
@click.option("--json", "as_json", is_flag=True, help="With --check or --list: print JSON for programs.")
@options.paths
@click.argument("words", nargs=-1, type=click.UNPROCESSED, metavar="(FILE | -m MODULE | PACKAGE EXECUTABLE) [ARGS]...")
def run(
    words: Sequence[str], paths: Sequence[str], check: bool, listed: bool, as_json: bool
) -> Callable[[], None] | None:
    """Run a program written for rclpy without changes and without a ROS installation.

    FILE and MODULE are as in python. PACKAGE is a package of the workspace, which needs no build, of pip, or of
    AMENT_PREFIX_PATH. EXECUTABLE is declared in its setup.py, setup.cfg, pyproject.toml or CMakeLists.txt, which are
    read, but not run.

    \b
    rosidl-py run talker.py
    rosidl-py run -m my_package.talker
    rosidl-py run my_package talker --ros-args -r chatter:=news
    rosidl-py run --check talker.py
    """
    from rosidl_py_gen.ros_cli.program_runner.run import start

    result = start(words, paths, check, listed, as_json)
    if not isinstance(result, int):
        return result  # called by `main` outside of its error handling
    if result:
        raise click.exceptions.Exit(result)
    return None
