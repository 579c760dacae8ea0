"""``interface list``, ``package`` and ``packages``."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.frontend.search_path import SearchPath


def _kind_options(command: Callable[..., Any]) -> Callable[..., Any]:
    for short, kind, what in (("-a", "actions", "actions"), ("-s", "srvs", "services"), ("-m", "msgs", "messages")):
        command = click.option(short, f"--only-{kind}", kind, is_flag=True, help=f"Show the {what}.")(command)
    return command


def _find_names(
    paths: tuple[str, ...], package: str, msgs: bool, srvs: bool, actions: bool
) -> tuple[SearchPath, list[str], list[RosName]]:
    """Return the search path, the selected kinds (all if none is given), and the interfaces of these kinds."""
    from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
    from rosidl_py_gen.ros_cli.definitions import names_of

    selected = {"msg": msgs, "srv": srvs, "action": actions}
    kinds = [kind for kind, is_selected in selected.items() if is_selected] or list(selected)
    search = scan_search_path(paths)
    return search, kinds, names_of(search, package, kinds)


@click.command("list")
@click.argument("package", required=False, shell_complete=options.completion("packages"))
@_kind_options
@options.paths
@options.as_json
@verb
def list_(package: str | None, paths: tuple[str, ...], as_json: bool, msgs: bool, srvs: bool, actions: bool) -> int:
    """Print the available interfaces, all or those of a package.

    \b
    rosidl-py interface list -s
    rosidl-py interface list --path ~/robot_ws/src my_msgs
    """
    from rosidl_py_gen.ros_cli.definitions import KINDS

    _, kinds, names = _find_names(paths, package or "", msgs, srvs, actions)
    if as_json:
        terminal_output.document([str(name) for name in names])
        return 0
    for kind in kinds:
        terminal_output.line(f"{KINDS[kind]}:", "bold")
        terminal_output.lines([f"    {name}" for name in names if name.kind == kind])
    return 0


@click.command("package")
@click.argument("package", shell_complete=options.completion("packages"))
@_kind_options
@options.paths
@options.as_json
@verb
def package(package: str, paths: tuple[str, ...], as_json: bool, msgs: bool, srvs: bool, actions: bool) -> int:
    """Print the interfaces of a package, one per line.

    \b
    rosidl-py interface package std_srvs
    """
    names = [str(name) for name in _find_names(paths, package, msgs, srvs, actions)[2]]
    if as_json:
        terminal_output.document(names)
    else:
        terminal_output.lines(names)
    return 0


@click.command("packages")
@_kind_options
@options.paths
@options.as_json
@verb
def packages(paths: tuple[str, ...], as_json: bool, msgs: bool, srvs: bool, actions: bool) -> int:
    """Print the packages that have interfaces.

    \b
    rosidl-py interface packages -a
    """
    search, _, names = _find_names(paths, "", msgs, srvs, actions)
    packages = sorted({name.package for name in names})
    if as_json:
        origins = {name: package.origin for name, package in search.packages.items()}
        terminal_output.document([{"name": name, "origin": origins.get(name, "generated")} for name in packages])
    else:
        terminal_output.lines(packages)
    return 0
