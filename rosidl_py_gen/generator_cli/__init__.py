"""The command line `rosidl-py-gen`: its commands and options, and the exit codes of errors.

A command is implemented in `commands` or `diff`, which is imported when the command runs.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

import click

from rosidl_py_gen import __version__
from rosidl_py_gen.base.interrupts import command_interrupts
from rosidl_py_gen.base.project import importable_current_folder, with_project_path
from rosidl_py_gen.errors import DefinitionError, RosidlError
from rosidl_py_gen.generator_cli.diagnostics_output import (
    count,
    echo,
    print_json,
    print_line,
    print_notes,
    print_problems,
    rows,
)
from rosidl_py_gen.generator_cli.distro_option import DISTRIBUTION, distro

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

_F = TypeVar("_F", bound=Callable[..., Any])
_Complete = Callable[[click.Context, click.Parameter, str], "list[CompletionItem]"]


def _completion(function: str) -> _Complete:
    """Return a function that completes by one of `shells`, which is imported on demand."""

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        from rosidl_py_gen.generator_cli import shells

        items: list[CompletionItem] = getattr(shells, function)(ctx, param, incomplete)
        return items

    return complete


_PATH = click.option(
    "--path",
    "paths",
    multiple=True,
    metavar="DIR",
    shell_complete=_completion("complete_directories"),
    help="Folder of a package, of packages, or src of a workspace. May be repeated. "
    "Searched before those of pyproject.toml, AMENT_PREFIX_PATH and the bundled interfaces.",
)

_GENERATION_OPTIONS = ("out", "check", "listing", "keep_going")
_JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
_FILTER = partial(
    click.option, "--filter", "selection", default="", metavar="NAMES", shell_complete=_completion("complete_selection")
)
_OUT = partial(
    click.option, "--out", metavar="DIR", show_default=True, shell_complete=_completion("complete_directories")
)


def _paths(command: _F) -> _F:
    """Add ``--path`` and ``--distro``."""
    return _PATH(distro(command))  # type: ignore[no-any-return]


def _run(name: str, /, **arguments: Any) -> None:
    group_options: dict[str, Any] = click.get_current_context().obj or {}
    arguments["paths"] = with_project_path(group_options.get("paths", ()) + arguments["paths"])
    arguments["as_json"] = arguments["as_json"] or group_options.get("as_json", False)
    module = import_module(f"rosidl_py_gen.generator_cli.{'diff' if name == 'diff' else 'commands'}")
    code = getattr(module, name)(**arguments)
    if code:
        raise click.exceptions.Exit(code)


class _Group(click.Group):
    """Group that explains a package name in the place of a command."""

    def resolve_command(self, context: click.Context, args: list[str]) -> tuple[Any, Any, list[str]]:
        if args and self.get_command(context, args[0]) is None:
            context.fail(f'no command "{args[0]}"; select packages and interfaces with --filter {args[0]}')
        return super().resolve_command(context, args)


@click.group(cls=_Group, invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="rosidl-py-gen")
@_paths
@_FILTER(
    envvar="IDL_PACKAGE_FILTER",
    help="Packages, or interfaces as package/msg/Name, separated by : or ;. Dependencies are added. "
    "[default: IDL_PACKAGE_FILTER, else all packages]",
)
@_OUT(default=".", help="Folder that receives the generated packages.")
@click.option("--check", is_flag=True, help="Write nothing; exit with 1 if a file would change.")
@click.option("--keep-going", is_flag=True, help="Generate the valid interfaces even if others have problems.")
@click.option(
    "--install",
    "action",
    flag_value="install",
    help="Install the packages into this Python environment by pip; generate no other files.",
)
@click.option(
    "--uninstall",
    "action",
    flag_value="uninstall",
    help="Uninstall message packages of --install and of wheels: all, or those of --filter.",
)
@click.option(
    "--force",
    is_flag=True,
    help="With --install: install although rclpy is importable, and replace packages of other tools. "
    "With --uninstall: also remove modified packages.",
)
@click.option("--list", "listing", is_flag=True, help="Print the packages of the search path with their origin.")
@_JSON
@click.pass_context
def _cli(context: click.Context, /, **arguments: Any) -> None:
    """Generate typed Python packages from ROS 2 interface definitions.

    At least one of --filter, --path and --out is required; --out . generates all packages into the current folder.

    \b
    rosidl-py-gen --filter std_msgs:geometry_msgs
    rosidl-py-gen --path ~/robot_ws/src --filter my_msgs --out generated
    rosidl-py-gen --filter std_msgs:geometry_msgs --install
    """
    if os.environ.get("NO_COLOR"):
        context.color = False
    if context.invoked_subcommand is None:
        if not _has_selection(context, arguments):
            echo(context.get_help(), err=True)
            raise click.exceptions.Exit(2)  # as click does for commands that take no_args_is_help
        if arguments["selection"] and not arguments["selection"].strip(":;, "):
            context.fail(f"--filter {arguments['selection']!r} has no names")
        action, force = arguments.pop("action"), arguments.pop("force")
        if action is None:
            if force:
                context.fail("--force belongs to --install and --uninstall")
            _run("generate_or_list", **arguments)
        else:
            _refuse(context, _GENERATION_OPTIONS, f"and --{action} do not go together")
            chosen = {name: arguments[name] for name in ("paths", "selection", "as_json")}
            _run("install", action=action, force=force, **chosen)
        return
    command = context.invoked_subcommand
    others = ("action", "force", *(("selection",) if command != "check" else ()))
    _refuse(context, (*_GENERATION_OPTIONS, *others), f"has no meaning for the command {command}")
    context.obj = arguments


def _refuse(context: click.Context, names: tuple[str, ...], reason: str) -> None:
    for name in names:
        if _is_typed(context, name):
            words = {"listing": "list", "selection": "filter", "action": context.params["action"]}
            context.fail(f"--{words.get(name, name.replace('_', '-'))} {reason}")


def _has_selection(context: click.Context, arguments: dict[str, Any]) -> bool:
    """Return True if the options select something, so that all packages are not generated by accident."""
    options = ("check", "listing", "action", "paths", "selection")
    return any(arguments[name] for name in options) or any(_is_typed(context, name) for name in ("selection", "out"))


def _is_typed(context: click.Context, name: str) -> bool:
    return context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE


@_cli.command()
@click.argument("names", nargs=-1, shell_complete=_completion("complete_packages_and_interfaces"))
@_paths
@_JSON
def check(**arguments: Any) -> None:
    """Read definitions and report their problems.

    NAMES are packages or interfaces. [default: IDL_PACKAGE_FILTER, else all packages]
    """
    selection = (click.get_current_context().obj or {}).get("selection", "")
    arguments["names"] = arguments["names"] or tuple(part for part in selection.replace(";", ":").split(":") if part)
    _run("check", **arguments)


@_cli.command()
@click.argument("name", shell_complete=_completion("complete_interfaces"))
@_paths
@click.option("--full", is_flag=True, help="Print the text for bags: the definition and all that it uses.")
@_JSON
def interface(**arguments: Any) -> None:
    """Print a definition and its type hash.

    NAME is an interface such as std_srvs/srv/SetBool; --json prints the type description.
    """
    _run("interface", **arguments)


@_cli.command()
@click.argument("sources", nargs=-1, metavar="[OLD] [NEW]", shell_complete=_completion("complete_files"))
@_PATH
@click.option(
    "--distro",
    "distros",
    multiple=True,
    metavar="NAME",
    type=DISTRIBUTION,
    help="ROS 2 distribution: twice in the place of OLD and NEW, or once in that of OLD.",
)
@_FILTER(help="Packages or interfaces to compare, separated by : or ;.")
@click.option(
    "--fail-on",
    "fail_on",
    multiple=True,
    type=click.Choice(["data", "code", "hash", "default", "unit", "addition", "any", "nothing"]),
    help="Exit with 1 on changes of this kind. May be repeated. [default: data, code]",
)
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(0),
    default=5.0,
    show_default=True,
    metavar="SECONDS",
    help="Maximum time to wait for a node, in seconds.",
)
@_JSON
def diff(**arguments: Any) -> None:
    """Compare definitions: additions, removals and changes, and whether old data can be read.

    OLD and NEW are each a folder of packages, a git revision (main, or v1.2:src/my_msgs), a bag, or a running node by
    its full name (/robot). The prefixes folder:, git:, bag:, node: and distro: state the kind. Exits with 1 on a
    breaking change.

    
    rosidl-py-gen diff main .
    rosidl-py-gen diff v1.2:src/my_msgs HEAD:src/my_msgs --json
    rosidl-py-gen diff drive.mcap ~/robot_ws/src --fail-on data
    rosidl-py-gen diff /robot ~/robot_ws/src --fail-on hash
    rosidl-py-gen diff --distro humble --distro lyrical
    """
    sources = (*(f"distro:{name.lower()}" for name in arguments.pop("distros")), *arguments.pop("sources"))
    if len(sources) != 2:
        raise click.UsageError(f"expected OLD and NEW, each a source or --distro NAME; found {len(sources)}")
    _run("diff", old=sources[0], new=sources[1], **arguments)


@_cli.command()
@click.argument("names", nargs=-1, shell_complete=_completion("complete_packages"))
@_paths
@_OUT(default="dist", help="Folder that receives the wheels.")
@click.option("--no-dependencies", is_flag=True, help="Make no wheels of packages that NAMES depend on.")
@_JSON
def wheel(**arguments: Any) -> None:
    """Make a pip wheel of each message package, and of its dependencies that are not installed.

    NAMES are packages. [default: all in the folders of --path] Name, version and other metadata are from package.xml.

    \b
    rosidl-py-gen wheel --path ~/robot_ws/src/my_msgs --out dist
    pip install --find-links dist my-msgs
    """
    _run("wheel", **arguments)


@_cli.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the completion script of a shell.

    \b
    eval "$(rosidl-py-gen completion bash)"      # in ~/.bashrc; zsh: the same in ~/.zshrc, after compinit
    rosidl-py-gen completion fish > ~/.config/fish/completions/rosidl-py-gen.fish
    """
    from rosidl_py_gen.generator_cli import shells

    echo(shells.script(shell, _cli, "rosidl-py-gen"))


def main(arguments: list[str] | None = None) -> None:
    """Run the console script; exit code 0 for success, 1 for problems, 2 for a wrong command line."""
    with command_interrupts.handling(arguments is None):
        _main(arguments)


def _main(arguments: list[str] | None) -> None:
    as_json = "--json" in (sys.argv[1:] if arguments is None else arguments)
    if "_ROSIDL_PY_GEN_COMPLETE" in os.environ:
        import_module("rosidl_py_gen.generator_cli.shells").install()
    try:
        with importable_current_folder():
            code = _cli.main(arguments, prog_name="rosidl-py-gen", standalone_mode=False)
        if isinstance(code, int) and code:
            sys.exit(code)
    except RosidlError as error:
        _report(error, as_json)
        sys.exit(1)
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        _report(RosidlError(f"{place}{error.strerror or error}"), as_json)
        sys.exit(1)
    except click.ClickException as wrong:
        shown = io.StringIO()
        wrong.show(shown)
        echo(shown.getvalue().rstrip("\n"), err=True)
        sys.exit(wrong.exit_code)
    except (click.Abort, KeyboardInterrupt):
        echo("interrupted; all written files are complete", err=True)
        sys.exit(130)


def _report(error: RosidlError, as_json: bool) -> None:
    if not isinstance(error, DefinitionError):
        if as_json:
            print_json({"errors": [{"path": "", "line": 0, "column": 0, "text": str(error)}]})
        else:
            print_line(f"error: {error}", "red")
        return
    if as_json:
        print_json({"errors": rows(error.diagnostics), "notes": rows(error.notes)})
        return
    print_notes(error.notes)
    print_problems(error.diagnostics)
    if len(error.diagnostics) > 1 or error.partial:
        option = " (--keep-going generates the valid interfaces)" if error.partial else ""
        print_line(f"{count(error.diagnostics)}; nothing was written{option}")
