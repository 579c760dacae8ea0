"""Commands of `rosidl-py-gen` with their options, and the exit codes of errors.

Commands import the compiler when they run, so help and completion load little; `diff` is in a module of its own.
"""

from __future__ import annotations

import os
import re
import shlex
import sys
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from rosidl_py_gen import __version__
from rosidl_py_gen.base.interrupts import command_interrupts
from rosidl_py_gen.base.project import GeneratedPackages, with_project_path
from rosidl_py_gen.base.terminal_text import pluralize, print_next_step
from rosidl_py_gen.errors import DefinitionError, RosidlError, TypeNotFoundError
from rosidl_py_gen.generator_cli.command_line import (
    DISTRIBUTION,
    HintedUsageError,
    count,
    distro,
    echo,
    lazy_completion,
    print_json,
    print_line,
    print_notes,
    print_problems,
    rows,
    split_filter,
)

if TYPE_CHECKING:
    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.frontend import SearchPath
    from rosidl_py_gen.compiler.generate import GenerationResult

_F = TypeVar("_F", bound=Callable[..., Any])


_completion = partial(lazy_completion, "rosidl_py_gen.generator_cli.shells")
"""Function that takes the name of a function in the module `shells` and returns a completion callback that calls it."""
_PATH = click.option(
    "--path",
    "paths",
    multiple=True,
    metavar="DIR",
    shell_complete=_completion("complete_directories"),
    help="Folder of a package, of packages, or src of a workspace. May be repeated. "
    "Searched before the folders of pyproject.toml, AMENT_PREFIX_PATH, installed and bundled packages.",
)

_PROGRESS_DELAY_S = 1.0
"""Time in seconds that a generation must run before a progress bar appears."""
_GENERATION_OPTIONS = ("out", "check", "listing", "keep_going")
_JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
_FILTER = partial(
    click.option,
    "--filter",
    "selection",
    multiple=True,
    callback=lambda context, parameter, values: ":".join(values),
    metavar="NAMES",
    shell_complete=_completion("complete_selection"),
)
_OUT = partial(
    click.option,
    *("-o", "--output", "--out", "out"),
    metavar="DIR",
    show_default=True,
    shell_complete=_completion("complete_directories"),
)


def _paths(command: _F) -> _F:
    """Add the options ``--path`` and ``--distro`` to a command."""
    return _PATH(distro(command))  # type: ignore[no-any-return]


def _search(paths: tuple[str, ...]) -> SearchPath:
    """Return the search path of a command, from ``--path`` before and after its name, folders of the project, and
    defaults.
    """
    from rosidl_py_gen.compiler.frontend import SearchPath

    return SearchPath.scan(_all_paths(paths))


def _all_paths(paths: tuple[str, ...]) -> tuple[str, ...]:
    return with_project_path((*_group_option("paths", ()), *paths))


def _group_option(name: str, otherwise: Any) -> Any:
    """Return the value of an option that precedes the command name of `rosidl-py-gen`.

    Returns `otherwise` if the option is unknown.
    """
    return (click.get_current_context().obj or {}).get(name, otherwise)


class _Group(click.Group):
    """Group of commands; the error for an unknown command suggests ``--filter``, as users type a package name there."""

    def resolve_command(self, context: click.Context, args: list[str]) -> tuple[Any, Any, list[str]]:
        if args and self.get_command(context, args[0]) is None:
            hint = f"select packages and interfaces with --filter {args[0]}"
            raise HintedUsageError(f'no command "{args[0]}"', hint, context)
        return super().resolve_command(context, args)


@click.group(cls=_Group, invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="rosidl-py-gen")
@_paths
@_FILTER(
    envvar="IDL_PACKAGE_FILTER",
    help="Packages, or interfaces as package/msg/Name, separated by : or ;. May be repeated. Dependencies are added. "
    "[default: IDL_PACKAGE_FILTER, else all packages]",
)
@_OUT(default=".", help="Folder that receives the generated packages.")
@click.option("--check", is_flag=True, help="Write nothing; exit with 1 if a file would change.")
@click.option("--keep-going", is_flag=True, help="Generate the valid interfaces even if others have problems.")
@click.option(
    "--install",
    "action",
    flag_value="install",
    help="Install the packages into this Python environment by pip or uv; generate no other files.",
)
@click.option(
    "--uninstall",
    "action",
    flag_value="uninstall",
    help="Uninstall message packages of --install and of wheels: all, or the packages of --filter.",
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
def cli(
    context: click.Context,
    /,
    paths: tuple[str, ...],
    selection: str,
    out: str,
    check: bool,
    keep_going: bool,
    action: str | None,
    force: bool,
    listing: bool,
    as_json: bool,
) -> None:
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
        if not _has_selection(context):
            echo(context.get_help(), err=True)
            raise click.exceptions.Exit(2)  # as click does for commands that take no_args_is_help
        if selection and not selection.strip(":;, "):
            context.fail(f"--filter {selection!r} has no names")
        if action is not None:
            _refuse(context, _GENERATION_OPTIONS, f"and --{action} do not go together")
            _install(action, paths, selection, force, as_json)
        elif force:
            context.fail("--force belongs to --install and --uninstall")
        elif listing:
            _list(paths, selection, as_json)
        else:
            _generate(paths, selection, out, check, keep_going, as_json)
        return
    command = context.invoked_subcommand
    others = ("action", "force", *(("selection",) if command != "check" else ()))
    _refuse(context, (*_GENERATION_OPTIONS, *others), f"has no meaning for the command {command}")
    context.obj = context.params


def _refuse(context: click.Context, names: tuple[str, ...], reason: str) -> None:
    for name in names:
        if _is_typed(context, name):
            words = {"listing": "list", "selection": "filter", "action": context.params["action"]}
            context.fail(f"--{words.get(name, name.replace('_', '-'))} {reason}")


def _has_selection(context: click.Context) -> bool:
    """Return True if an option states what to generate.

    Without one, the command prints its help and does not generate all packages.
    """
    options = ("check", "listing", "action", "paths", "selection")
    return any(context.params[name] for name in options) or any(
        _is_typed(context, name) for name in ("selection", "out")
    )


def _is_typed(context: click.Context, name: str) -> bool:
    return context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE


def _install(action: str, paths: tuple[str, ...], selection: str, force: bool, as_json: bool) -> None:
    """Install or uninstall (`action`) message packages in this Python environment, and print their names."""
    from rosidl_py_gen.wheels import Installer

    wanted = sorted({name.partition("/")[0] for name in split_filter(selection)})
    if action == "uninstall":
        changed = Installer.uninstall_packages(wanted, force=force)
    else:
        changed = Installer.install_packages(_search(paths), wanted, force=force)
    if not as_json:
        place = f"{'into' if action == 'install' else 'from'} {sys.prefix}: "
        echo(f"{action}ed {place if changed else ''}{', '.join(changed) or 'nothing'}")
    libraries = [] if action == "uninstall" else _install_library(as_json)
    if as_json:
        print_json({action: changed} | ({"libddsc": libraries[0]} if libraries else {}))


def _install_library(as_json: bool) -> list[str]:
    """Install the library libddsc if the extra ``node`` is installed but the library is missing.

    Returns the path of the installed library in a list, else [].
    """
    from importlib.util import find_spec

    if find_spec("yaml") is None or find_spec("rich") is None:
        return []
    from rosidl_py_gen.wheels import InstalledLibrary

    found = InstalledLibrary.install_missing()
    if found is None:
        return []
    if not as_json:
        echo(found.text)
    return [found.path]


def _generate(paths: tuple[str, ...], selection: str, out: str, check: bool, keep_going: bool, as_json: bool) -> None:
    from rosidl_py_gen.compiler.generate import generate

    progress = _Progress()
    try:
        search, wanted = _search(paths), split_filter(selection)
        result = generate(search, wanted, Path(out), dry=check, keep_going=keep_going, progress=progress)
    finally:
        progress.close()
    _print(result, out, check, as_json)
    if result.problems or (check and (result.changes.written or result.changes.removed)):
        raise click.exceptions.Exit(1)


class _Progress:
    """Progress callback of a generation; displays a bar on standard error if the generation takes over a second."""

    def __init__(self) -> None:
        self._start = time.monotonic()
        self._bar: Any = None
        self._terminal = sys.stderr.isatty()

    def __call__(self, name: RosName, done: int, total: int) -> None:
        if not self._terminal or time.monotonic() - self._start < _PROGRESS_DELAY_S:
            return
        if self._bar is None:
            self._bar = click.progressbar(length=total, label="generating", file=sys.stderr)
            self._bar.__enter__()
            self._bar.update(done)
        self._bar.update(1)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.__exit__(None, None, None)


def _print(result: GenerationResult, out: str, check: bool, as_json: bool) -> None:
    changes = result.changes
    if as_json:
        print_json(
            {
                "out": out,
                "interfaces": [str(name) for name in result.names],
                "written": list(changes.written),
                "removed": list(changes.removed),
                "unchanged": changes.unchanged,
                "errors": rows(result.problems),
                "notes": rows(result.notes),
            }
        )
        return
    print_notes(result.notes)
    print_problems(result.problems)
    if check:
        for name in changes.written:
            echo(f"would write {Path(out) / name}")
        for name in changes.removed:
            echo(f"would remove {Path(out) / name}")
    packages = len({name.package for name in result.names})
    verb = "would be written" if check else "written"
    echo(
        f"{pluralize(len(result.names), 'interface')} in {pluralize(packages, 'package')}: "
        f"{pluralize(len(changes.written), 'file')} {verb}, {len(changes.removed)} removed, "
        f"{changes.unchanged} unchanged"
    )
    if result.problems:
        print_line(f"{count(result.problems)}; interfaces with problems were skipped")


def _list(paths: tuple[str, ...], selection: str, as_json: bool) -> None:
    search = _search(paths)
    chosen = {text.split("/")[0] for text in split_filter(selection)} or {*search.packages}
    every = [(package, True) for package in search.packages.values()] + [(package, False) for package in search.hidden]
    found = [row for row in every if row[0].name in chosen]
    found.sort(key=lambda row: (row[0].name, not row[1]))
    if as_json:
        print_json(
            [
                {
                    "package": package.name,
                    "folder": str(package.folder),
                    "origin": package.origin,
                    "used": used,
                    "interfaces": [str(name) for name in package.files],
                }
                for package, used in found
            ]
        )
        return
    width = max((len(package.name) for package, _ in found), default=0)
    for package, used in found:
        note = "" if used else "  (hidden by the one above)"
        place = package.origin if package.is_bundled else str(package.folder)
        echo((package.name.ljust(width), "bold" if used else ""), f"  {len(package.files):3}  {place}{note}")


@cli.command()
@click.argument("names", nargs=-1, shell_complete=_completion("complete_packages_and_interfaces"))
@_paths
@_JSON
def check(names: tuple[str, ...], paths: tuple[str, ...], as_json: bool) -> None:
    """Read definitions and report their problems.

    NAMES are packages or interfaces. [default: IDL_PACKAGE_FILTER, else all packages]
    """
    from rosidl_py_gen.compiler.generate import LoadedInterfaces

    search = _search(paths)
    _, found = LoadedInterfaces.load(search, [*names] or split_filter(_group_option("selection", "")))
    notes = search.notes(found)
    packages = sorted({name.package for name in found})
    if as_json or _group_option("as_json", False):
        interfaces = [str(name) for name in found]
        print_json({"interfaces": interfaces, "errors": [], "notes": rows(notes)})
    else:
        print_notes(notes)
        echo(f"{pluralize(len(found), 'interface')} in {pluralize(len(packages), 'package')}: no problems")


@cli.command()
@click.argument("name", shell_complete=_completion("complete_interfaces"))
@_paths
@click.option("--full", is_flag=True, help="Print the text for bags: the definition and all that it uses.")
@_JSON
def interface(name: str, paths: tuple[str, ...], full: bool, as_json: bool) -> None:
    """Print a definition and its type hash.

    NAME is an interface such as std_srvs/srv/SetBool; --json prints the type description.
    """
    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.frontend import DefinitionText, InterfaceRegistry
    from rosidl_py_gen.type_loading import GeneratedDefinition

    top = RosName.parse(name, "msg")
    registry, generated = InterfaceRegistry(_search(paths)), None
    try:
        owner = registry.read_checked(top)
    except TypeNotFoundError:
        generated = GeneratedDefinition.find(name)
        if generated is None:
            raise
        registry, owner, note = generated
        print_line(f"note: {note}")
    if as_json or _group_option("as_json", False):
        print_json({"hash": registry.type_hash(str(top)), **registry.type_description(str(top))})
        return
    text = DefinitionText(registry, owner)
    if full:
        echo(text.full.removesuffix("\n"))
        return
    echo((f"# {top}  {registry.type_hash(str(top))}", "bold"))
    echo((text.source if generated is None else text.full).removesuffix("\n"))


@cli.command()
@click.argument("sources", nargs=-1, metavar="[OLD] [NEW]", shell_complete=_completion("complete_files"))
@_PATH
@click.option(
    "--distro",
    "distros",
    multiple=True,
    metavar="NAME",
    type=DISTRIBUTION,
    help="ROS 2 distribution: twice in the place of OLD and NEW, or once in the place of OLD.",
)
@_FILTER(help="Packages or interfaces to compare, separated by : or ;. May be repeated.")
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
def diff(paths: tuple[str, ...], as_json: bool, **arguments: Any) -> None:
    """Compare definitions: additions, removals and changes, and whether old data are read as before.

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
    compare = import_module("rosidl_py_gen.generator_cli.diff").diff
    if compare(*sources, paths=_all_paths(paths), as_json=as_json or _group_option("as_json", False), **arguments):
        raise click.exceptions.Exit(1)


@cli.command()
@click.argument("names", nargs=-1, shell_complete=_completion("complete_packages"))
@_paths
@_OUT(default="dist", help="Folder that receives the wheels.")
@click.option("--no-dependencies", is_flag=True, help="Make no wheels of packages that NAMES depend on.")
@_JSON
def wheel(names: tuple[str, ...], paths: tuple[str, ...], out: str, no_dependencies: bool, as_json: bool) -> None:
    """Make a pip wheel of each message package, and of its dependencies that are not installed.

    NAMES are packages. [default: all in the folders of --path, else all bundled packages] Name, version and other
    metadata are from package.xml.

    \b
    rosidl-py-gen wheel --path ~/robot_ws/src/my_msgs --out dist
    pip install dist/*.whl
    """
    from rosidl_py_gen.wheels import build_wheels

    built = build_wheels(_search(paths), [*names], Path(out), dependencies=not no_dependencies)
    if as_json or _group_option("as_json", False):
        print_json([{"package": one.package, "path": str(one.path), "requires": list(one.requires)} for one in built])
        return
    for one in built:
        echo(str(one.path))
    if built:
        print_next_step("pip install", shlex.quote(f"{out}/") + "*.whl")
    made = {"rosidl-py-gen", *(one.package for one in built)}
    required = {text for one in built for text in one.requires}
    if missing := sorted(text for text in required if re.split("[=>]", text)[0] not in made):
        reason = "" if no_dependencies else ", because they are installed"
        texts = ", ".join(missing)
        echo(f"required, but not made{reason}: {texts}; name packages to make wheels of them", err=True)


@cli.command()
@click.option(
    "--from",
    "file",
    metavar="FILE",
    type=click.Path(dir_okay=False),
    help="Wheel of cyclonedds with the library, instead of the wheel of the package index.",
)
@_JSON
def libddsc(file: str | None, as_json: bool) -> None:
    """Install the C library of Cyclone DDS, which DDS needs, into this Python environment.

    The library is taken from the wheel of cyclonedds for another Python, because it does not depend on the Python. pip
    or uv downloads that wheel with your settings of the package index, and its SHA-256 is checked. Nothing is installed
    if a library is found, except with --from. `--install` does the same where it is needed.

    \b
    rosidl-py-gen libddsc
    rosidl-py-gen libddsc --from cyclonedds-11.0.1-cp313-cp313-win_amd64.whl
    """
    from rosidl_py_gen.runtime.transport.cyclone import library
    from rosidl_py_gen.wheels import InstalledLibrary

    is_found = file is None and library.is_found()
    path = library.find_library().file if is_found else (installed := InstalledLibrary.install(file)).path
    if as_json or _group_option("as_json", False):
        print_json({"libddsc": path, "installed": not is_found})
    else:
        echo(f"nothing to install: {library.find_library()}" if is_found else installed.text)


@cli.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the completion script of a shell.

    \b
    eval "$(rosidl-py-gen completion bash)"      # in ~/.bashrc; zsh: the same in ~/.zshrc, after compinit
    rosidl-py-gen completion fish > ~/.config/fish/completions/rosidl-py-gen.fish
    """
    from rosidl_py_gen.generator_cli.shells import completion_script

    echo(completion_script(shell, cli, "rosidl-py-gen"))


def main(arguments: list[str] | None = None) -> None:
    """Run the console script; exit code 0 for success, 1 for problems, 2 for a wrong command line."""
    with command_interrupts.handling(arguments is None):
        _main(arguments)


def _main(arguments: list[str] | None) -> None:
    as_json = "--json" in (sys.argv[1:] if arguments is None else arguments)
    if "_ROSIDL_PY_GEN_COMPLETE" in os.environ:
        from rosidl_py_gen.generator_cli.shells import install_completion

        install_completion()
    try:
        with GeneratedPackages.of_current_folder():
            code = cli.main(arguments, prog_name="rosidl-py-gen", standalone_mode=False)
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
        echo(HintedUsageError.text_of(wrong), err=True)
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
