"""``interface list``, ``package`` and ``packages``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from rosidl_py_gen.ros_cli import options, terminal_output, verb


def _kind_options(command: Callable[..., Any]) -> Callable[..., Any]:
    for short, kind, what in (("-a", "actions", "actions"), ("-s", "srvs", "services"), ("-m", "msgs", "messages")):
        command = click.option(short, f"--only-{kind}", kind, is_flag=True, help=f"Show the {what}.")(command)
    return command


def _selected_kinds(msgs: bool, srvs: bool, actions: bool) -> list[str]:
    selected = {"msg": msgs, "srv": srvs, "action": actions}
    return [kind for kind, is_wanted in selected.items() if is_wanted] or list(selected)


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
    from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
    from rosidl_py_gen.ros_cli.definitions import KINDS, names_of

    kinds = _selected_kinds(msgs, srvs, actions)
    names = names_of(scan_search_path(paths), package or "", kinds)
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
    from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
    from rosidl_py_gen.ros_cli.definitions import names_of

    names = [str(name) for name in names_of(scan_search_path(paths), package, _selected_kinds(msgs, srvs, actions))]
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
    from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
    from rosidl_py_gen.ros_cli.definitions import names_of

    search = scan_search_path(paths)
    found = sorted({name.package for name in names_of(search, "", _selected_kinds(msgs, srvs, actions))})
    if as_json:
        origins = {name: package.origin for name, package in search.packages.items()}
        terminal_output.document([{"name": name, "origin": origins.get(name, "generated")} for name in found])
    else:
        terminal_output.lines(found)
    return 0
