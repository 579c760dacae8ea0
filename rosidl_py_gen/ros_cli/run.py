"""Commands that run the code of a workspace: ``rosidl-py run`` and ``rosidl-py test``."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path

import click

from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.ros_cli import options

_PLUGIN = "rosidl_py_gen.program_runner.missing_test_tools"
_TEST_COMMANDS = {"ament_add_pytest_test": 1, "add_launch_test": 0}
"""Commands of CMakeLists.txt that declare a Python test, with the index of the argument that names its file."""


class _Program(click.Command):
    """Click command that passes all words after the name of a program on to the program, as python does."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        known = {name: one for one in self.get_params(ctx) for name in one.opts if isinstance(one, click.Option)}
        index = 0
        while index < len(args) and (one := known.get(args[index].partition("=")[0])) is not None:
            index += 1 if one.is_flag or "=" in args[index] else 2
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
) -> Callable[[], None] | int:
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
    if listed and len(words) > 1:
        raise click.UsageError("expected at most a package")
    if as_json and not (listed or check):
        raise click.UsageError("--json requires --check or --list; options of the program follow the program")
    if not (listed or words):
        raise click.UsageError("expected a file, -m and a module, or a package and an executable")
    if not listed and words[0] == "-m" and not words[1:]:
        raise click.UsageError("expected a module after -m")
    from rosidl_py_gen.program_runner.run import start

    return start(words, paths, check, listed, as_json)


@click.command("test", no_args_is_help=True, context_settings={"allow_interspersed_args": False})
@options.paths
@click.argument("package", metavar="PACKAGE", shell_complete=options.completion("workspace packages"))
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED, metavar="[PYTEST ARGS]...")
def test(package: str, arguments: tuple[str, ...], paths: Sequence[str]) -> Callable[[], None]:
    """Run the pytest tests of a package of the workspace, which needs no build.

    pytest runs in the folder of the package, and all packages of the workspace can be imported and launched. Tests that
    need linters of ament or launch_testing are skipped if these are not installed.

    \b
    rosidl-py test my_package
    rosidl-py test my_package -k talker -x
    """
    from rosidl_py_gen.base.names import did_you_mean
    from rosidl_py_gen.prefix import build_prefix, workspaces

    if find_spec("pytest") is None:
        raise CommandError("pytest is not installed: pip install pytest")
    found = workspaces(paths)
    folders = {name: folder for one in reversed(found) for name, folder in one.packages.items()}
    if package not in folders:
        searched = ", ".join(str(one.folder) for one in found)
        raise CommandError(f'no package "{package}"{did_you_mean(package, folders)}; searched {searched}')
    folder = folders[package]
    prefix = build_prefix((root for one in found for root in one.roots), runs_setup=True)
    for problem in (*prefix.problems, *prefix.notes):
        terminal_output.note(f"warning: {problem}")
    words = ["-m", "pytest", "-p", _PLUGIN, "-rs", "-o", f"cache_dir={prefix.folder / '.pytest_cache'}", *arguments]
    if not any((folder / word.partition("::")[0]).exists() for word in arguments if not word.startswith("-")):
        words += _declared_tests(folder)
    environment = os.environ | prefix.variables
    os.chdir(folder)
    return lambda: os.execve(sys.executable, [sys.executable, *words], environment)


def _declared_tests(folder: Path) -> list[str]:
    """Return the paths of tests that CMakeLists.txt declares; [] if it is missing, or a path does not exist."""
    from rosidl_py_gen.compiler.frontend import CMakeScript, PackageFiles, UnreadableError

    try:
        calls = CMakeScript.read(folder).calls
    except UnreadableError:
        return []
    found = [(words, _TEST_COMMANDS[name]) for name, words in calls if name in _TEST_COMMANDS]
    declared = [PackageFiles.inside(words[at].text) or "" for words, at in found if at < len(words)]
    return declared if all(path and (folder / path).exists() for path in declared) else []
