"""Completion of `rosidl-py-gen`: packages and interfaces of the search path, folders and files."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.generator_cli.shells import complete_directories as complete_directories
from rosidl_py_gen.generator_cli.shells import complete_files as complete_files
from rosidl_py_gen.generator_cli.shells import items

if TYPE_CHECKING:
    import click
    from click.shell_completion import CompletionItem

    from rosidl_py_gen.compiler.frontend.search_path import Package


def complete_packages(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the name of a package."""
    return items((package.name for package in _packages(ctx)), incomplete)


def complete_interfaces(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the name of a message, service or action."""
    return items((str(name) for package in _packages(ctx) for name in package.files), incomplete)


def complete_packages_and_interfaces(
    ctx: click.Context, param: click.Parameter, incomplete: str
) -> list[CompletionItem]:
    """Complete the name of a package; once a ``/`` is typed, of an interface in it."""
    complete = complete_interfaces if "/" in incomplete else complete_packages
    return complete(ctx, param, incomplete)


def complete_selection(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the last of several names that are separated by ``:`` or ``;``."""
    *_, last = re.split("[:;]", incomplete)
    before = incomplete.removesuffix(last)
    found = complete_packages_and_interfaces(ctx, param, last)
    return items((before + item.value for item in found), incomplete)


def _packages(ctx: click.Context) -> list[Package]:
    above = ctx.parent.params.get("paths") if ctx.parent else None
    try:
        return list(scan_search_path((*(above or ()), *(ctx.params.get("paths") or ()))).packages.values())
    except (RosidlError, OSError):
        return []
