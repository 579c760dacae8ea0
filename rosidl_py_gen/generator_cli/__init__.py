"""The command line. The only package that imports click.

This file knows the commands and how errors end a run; each command's body is in a file of its own and loaded when it
runs, so that ``--help`` is quick.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen import __version__
from rosidl_py_gen.base.interrupts import command_interrupts
from rosidl_py_gen.base.project import importable_current_folder, with_project_path
from rosidl_py_gen.errors import DefinitionError, RosidlError
from rosidl_py_gen.generator_cli import diagnostics_output

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

_Complete = Callable[[click.Context, click.Parameter, str], "list[CompletionItem]"]


def _completion(what: str) -> _Complete:
    """Complete by a function of `cli.completers`, which is loaded when a shell completes."""

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        from rosidl_py_gen.generator_cli import completers

        found: list[CompletionItem] = getattr(completers, what)(ctx, param, incomplete)
        return found

    return complete


_PATH = click.option(
    "--path",
    "paths",
    multiple=True,
    metavar="DIR",
    shell_complete=_completion("complete_directories"),
    help="A package folder, a folder of packages or a workspace's src; may be given several times. "
    "Looked through before those of pyproject.toml, AMENT_PREFIX_PATH and the bundled interfaces.",
)
_JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON for programs.")


def _run(module: str, **arguments: Any) -> None:
    above: dict[str, Any] = click.get_current_context().obj or {}
    arguments["paths"] = with_project_path(above.get("paths", ()) + arguments["paths"])
    arguments["as_json"] = arguments["as_json"] or above.get("as_json", False)
    code = import_module(f"rosidl_py_gen.generator_cli.{module}").run(**arguments)
    if code:
        raise click.exceptions.Exit(code)


class _Group(click.Group):
    """Knows what people mean who give package names where a command is expected."""

    def resolve_command(self, context: click.Context, args: list[str]) -> tuple[Any, Any, list[str]]:
        if args and self.get_command(context, args[0]) is None:
            context.fail(f'no command "{args[0]}"; packages and interfaces are chosen with --filter {args[0]}')
        return super().resolve_command(context, args)


@click.group(cls=_Group, invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="rosidl-py-gen")
@_PATH
@click.option(
    "--filter",
    "selection",
    envvar="IDL_PACKAGE_FILTER",
    default="",
    metavar="NAMES",
    shell_complete=_completion("complete_selection"),
    help="Packages, or single interfaces as package/msg/Name, separated by : or ; (default: IDL_PACKAGE_FILTER, else "
    "everything found). What they depend on is added.",
)
@click.option(
    "--out",
    default=".",
    metavar="DIR",
    show_default=True,
    shell_complete=_completion("complete_directories"),
    help="Receives the generated packages.",
)
@click.option("--check", is_flag=True, help="Write nothing; exit with 1 if anything would change.")
@click.option("--keep-going", is_flag=True, help="Generate what is right even if some definitions are wrong.")
@click.option(
    "--install",
    "action",
    flag_value="install",
    help="Install the packages into this Python's environment, by pip; nothing is generated anywhere else.",
)
@click.option(
    "--uninstall",
    "action",
    flag_value="uninstall",
    help="Take back what --install and wheels brought: all, or those of --filter.",
)
@click.option("--force", is_flag=True, help="With these two: beside ROS, over packages of others, and changed ones.")
@click.option("--list", "listing", is_flag=True, help="Print the packages found, and from where.")
@_JSON
@click.pass_context
def _cli(context: click.Context, /, **arguments: Any) -> None:
    """Generate typed Python packages from ROS 2 interface definitions.

    At least one of --filter, --path and --out says what is wanted; --out . generates everything into this folder.

    \b
    rosidl-py-gen --filter std_msgs:geometry_msgs
    rosidl-py-gen --path ~/robot_ws/src --filter my_msgs --out generated
    rosidl-py-gen --filter std_msgs:geometry_msgs --install
    """
    if os.environ.get("NO_COLOR"):
        context.color = False
    if context.invoked_subcommand is None:
        if not _has_selection(context, arguments):
            diagnostics_output.echo(context.get_help(), err=True)
            raise click.exceptions.Exit(2)  # as click does for commands that take no_args_is_help
        if arguments["selection"] and not arguments["selection"].strip(":;, "):
            context.fail(f"--filter {arguments['selection']!r} names nothing")
        action, force = arguments.pop("action"), arguments.pop("force")
        if action is None:
            if force:
                context.fail("--force belongs to --install and --uninstall")
            _run("generate", **arguments)
            return
        for name in ("out", "check", "listing", "keep_going"):
            if _is_typed(context, name):
                option = "list" if name == "listing" else name.replace("_", "-")
                context.fail(f"--{option} and --{action} do not go together")
        chosen = {name: arguments[name] for name in ("paths", "selection", "as_json")}
        _run("install", action=action, force=force, **chosen)
        return
    given = [name for name in ("out", "check", "listing", "keep_going", "action", "force") if _is_typed(context, name)]
    if _is_typed(context, "selection") and context.invoked_subcommand != "check":
        given.append("selection")
    if given:
        named = {"listing": "--list", "selection": "--filter", "action": f"--{arguments['action']}"}
        option = named.get(given[0], "--" + given[0].replace("_", "-"))
        context.fail(f"{option} has no meaning for the command {context.invoked_subcommand}")
    context.obj = arguments


def _has_selection(context: click.Context, arguments: dict[str, Any]) -> bool:
    """Whether the main job shall run: nobody wants all packages in the current folder by accident."""
    writes_nothing = arguments["check"] or arguments["listing"]
    if arguments["action"]:
        return True
    return bool(writes_nothing or arguments["paths"] or arguments["selection"]) or any(
        _is_typed(context, name) for name in ("selection", "out")
    )


def _is_typed(context: click.Context, name: str) -> bool:
    return context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE


@_cli.command()
@click.argument("names", nargs=-1, shell_complete=_completion("complete_packages_and_interfaces"))
@_PATH
@_JSON
def check(**arguments: Any) -> None:
    """Read definitions and report their problems, generating nothing.

    NAMES are packages or interfaces; without any, those of IDL_PACKAGE_FILTER, else everything found.
    """
    selection = (click.get_current_context().obj or {}).get("selection", "")
    arguments["names"] = arguments["names"] or tuple(part for part in selection.replace(";", ":").split(":") if part)
    _run("check", **arguments)


@_cli.command()
@click.argument("name", shell_complete=_completion("complete_interfaces"))
@_PATH
@click.option("--full", is_flag=True, help="The text bags carry: the definition and every one it uses.")
@_JSON
def interface(**arguments: Any) -> None:
    """Print a definition and its type hash.

    NAME is an interface such as std_srvs/srv/SetBool; --json prints the type description.
    """
    _run("interface", **arguments)


@_cli.command()
@click.argument("old", shell_complete=_completion("complete_files"))
@click.argument("new", shell_complete=_completion("complete_files"))
@_PATH
@click.option(
    "--filter",
    "selection",
    default="",
    metavar="NAMES",
    shell_complete=_completion("complete_selection"),
    help="Only these packages or interfaces, separated by : or ;.",
)
@click.option(
    "--fail-on",
    "fail_on",
    multiple=True,
    type=click.Choice(["data", "code", "hash", "default", "unit", "addition", "any", "nothing"]),
    help="Exit with 1 on changes of this sort; may be given several times.  [default: data, code]",
)
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(0),
    default=5.0,
    show_default=True,
    metavar="SECONDS",
    help="How long a node may take to appear.",
)
@_JSON
def diff(**arguments: Any) -> None:
    """Compare definitions: what was added, removed and changed, and whether old data are still read.

    OLD and NEW are each a folder of packages, a git revision (main, or v1.2:src/my_msgs), a bag, or a running node by
    its full name (/robot). With folder:, git:, bag: or node: in front, nothing is guessed. Exits with 1 on a breaking
    change.

    
    rosidl-py-gen diff main .
    rosidl-py-gen diff v1.2:src/my_msgs HEAD:src/my_msgs --json
    rosidl-py-gen diff drive.mcap ~/robot_ws/src --fail-on data
    rosidl-py-gen diff /robot ~/robot_ws/src --fail-on hash
    """
    _run("diff", **arguments)


@_cli.command()
@click.argument("names", nargs=-1, shell_complete=_completion("complete_packages"))
@_PATH
@click.option(
    "--out",
    default="dist",
    metavar="DIR",
    show_default=True,
    shell_complete=_completion("complete_directories"),
    help="Receives the wheels.",
)
@click.option("--no-dependencies", is_flag=True, help="No wheels of the packages that these use.")
@_JSON
def wheel(**arguments: Any) -> None:
    """Make a pip wheel of each message package, and of those they use that are not installed.

    NAMES are packages; without any, all in the folders of --path. Name, version and so on come from package.xml.

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

    diagnostics_output.echo(shells.script(shell, _cli, "rosidl-py-gen"))


def main(arguments: list[str] | None = None) -> None:
    """The console script: exit code 0 when all is well, 1 for problems found, 2 for a wrong command line."""
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
        diagnostics_output.echo(shown.getvalue().rstrip("\n"), err=True)
        sys.exit(wrong.exit_code)
    except (click.Abort, KeyboardInterrupt):
        diagnostics_output.echo("interrupted; every file written is whole", err=True)
        sys.exit(130)


def _report(error: RosidlError, as_json: bool) -> None:
    if not isinstance(error, DefinitionError):
        if as_json:
            diagnostics_output.print_json({"errors": [{"path": "", "line": 0, "column": 0, "text": str(error)}]})
        else:
            diagnostics_output.print_line(f"error: {error}", "red")
        return
    if as_json:
        diagnostics_output.print_json(
            {"errors": diagnostics_output.rows(error.diagnostics), "notes": diagnostics_output.rows(error.notes)}
        )
        return
    diagnostics_output.print_notes(error.notes)
    diagnostics_output.print_problems(error.diagnostics)
    if len(error.diagnostics) > 1 or error.partial:
        option = " (--keep-going generates what is right)" if error.partial else ""
        diagnostics_output.print_line(f"{diagnostics_output.count(error.diagnostics)}; nothing was written{option}")
