"""``rosidl-py run``."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import click

from rosidl_py_gen.ros_cli import options

_OWN = {"--path": True, "--check": False, "--list": False, "--json": False, "-h": False, "--help": False}
"""Our options, and which have a value."""


class _Program(click.Command):
    """Everything from the program on belongs to it, as with python itself."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        at = 0
        while at < len(args) and args[at].partition("=")[0] in _OWN:
            at += 2 if _OWN[args[at].partition("=")[0]] and "=" not in args[at] else 1
        if args[at : at + 1] == ["-m"] or not args[at : at + 1][0:1] or not args[at].startswith("-"):
            args = [*args[:at], "--", *args[at:]]
        return super().parse_args(ctx, args)


@click.command("run", cls=_Program, no_args_is_help=True)
@click.option("--check", is_flag=True, help="Run nothing; tell which names and packages it uses that are not here.")
@click.option("--list", "listed", is_flag=True, help="Run nothing; print the executables of PACKAGE, or of all.")
@click.option("--json", "as_json", is_flag=True, help="With --check or --list: print JSON for programs.")
@options.paths
@click.argument("words", nargs=-1, type=click.UNPROCESSED, metavar="(FILE | -m MODULE | PACKAGE EXECUTABLE) [ARGS]...")
def run(
    words: Sequence[str], paths: Sequence[str], check: bool, listed: bool, as_json: bool
) -> Callable[[], None] | None:
    """Run a program written for rclpy as it is, without a ROS installation.

    FILE and MODULE are as with python. PACKAGE is looked for in the workspace, which needs no build, in what pip
    installed, and in AMENT_PREFIX_PATH; EXECUTABLE is one that its setup.py, setup.cfg, pyproject.toml or
    CMakeLists.txt names. These are read, not run.

    \b
    rosidl-py run talker.py
    rosidl-py run -m my_package.talker
    rosidl-py run my_package talker --ros-args -r chatter:=news
    rosidl-py run --check talker.py
    """
    from rosidl_py_gen.ros_cli.program_runner.run import start

    answer = start(words, paths, check, listed, as_json)
    if not isinstance(answer, int):
        return answer  # called by `main` when nothing of ours is around it any more
    if answer:
        raise click.exceptions.Exit(answer)
    return None
