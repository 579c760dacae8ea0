"""Selection of the interfaces that can be generated although other interfaces have errors.

An interface is skipped if its own file has errors, or if it needs a skipped interface. In the second case it gets a
diagnostic with the cause.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.compiler.frontend.model import nested_types
from rosidl_py_gen.compiler.frontend.registry import type_location
from rosidl_py_gen.errors import Diagnostic, display_path

if TYPE_CHECKING:
    from collections.abc import Container

    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.frontend.model import FieldDef
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry


def drop_unused_invalid_files(
    registry: InterfaceRegistry, names: list[RosName], wanted: Container[str]
) -> list[RosName]:
    """Return the names without invalid files that no interface refers to, if CMakeLists.txt does not list the package's
    files.

    The diagnostics of skipped files become notes of their package. If this would skip all files of a package, none is
    skipped.

    Args:
        registry: contains the diagnostics of `check` for the names.
        names: a selection that has all its dependencies.
        wanted: full names that must not be dropped.
    """
    packages = registry.search.packages
    listings = {package: packages[package].listing for package in {name.package for name in names}}
    diagnostics = {problem.path: problem for problem in reversed(registry.diagnostics.items)}
    unused = {
        name: diagnostics[path]
        for name in _with_problems(registry, names)
        if (listing := listings[name.package]) and not listing.complete and str(name) not in wanted
        if (path := display_path(packages[name.package].files[name])) in diagnostics
    }
    users = _users(registry, names if unused else [])
    dropped: dict[RosName, Diagnostic] = {}
    pending = list(unused)
    for name in pending:  # grows inside the loop
        if name in unused and name not in dropped and users.get(name, {}).keys() <= {name, *dropped}:
            dropped[name] = unused[name]
            pending += [need for need, found in users.items() if name in found]
    rest = {name.package for name in names if name not in dropped}
    for name, problem in dropped.items():
        listing = listings[name.package]
        if name.package in rest and listing is not None:
            note = replace(problem, text=f"skipped, as no other file refers to it: {problem.text}")
            listing.notes += [note] if note not in listing.notes else []
            registry.diagnostics.items = [one for one in registry.diagnostics.items if one.path != problem.path]
    return [name for name in names if name not in dropped or name.package not in rest]


def split_valid(registry: InterfaceRegistry, names: list[RosName]) -> tuple[list[RosName], list[Diagnostic]]:
    """Return the usable interfaces of a checked selection, and diagnostics for interfaces that are valid but need an
    invalid one.
    """
    wrong = _with_problems(registry, names)
    if not wrong:
        return names, []
    causes = {name: name for name in wrong}  # skipped interface -> interface with problems
    users = _users(registry, names)
    problems: list[Diagnostic] = []
    pending = list(wrong)
    for skipped in pending:  # grows inside the loop
        for user, item in users.get(skipped, {}).items():
            if user not in causes:
                causes[user] = causes[skipped]
                text = f"{user} needs {causes[skipped]}, which has problems"
                problems.append(type_location(item).diagnostic(text))
                pending.append(user)
    return [name for name in names if name not in causes], problems


def _with_problems(registry: InterfaceRegistry, names: list[RosName]) -> list[RosName]:
    paths = {problem.path for problem in registry.diagnostics.items}
    files = ((name, registry.search.file(name)) for name in names)
    return [name for name, file in files if registry.interface(name) is None or (file and display_path(file) in paths)]


def _users(registry: InterfaceRegistry, names: list[RosName]) -> dict[RosName, dict[RosName, FieldDef]]:
    """Return a dictionary from each interface to the interfaces that use it, each with its first field of that type."""
    users: dict[RosName, dict[RosName, FieldDef]] = {}
    for name in names:
        interface = registry.interface(name)
        if interface is None:
            continue
        nested = nested_types(interface)
        for item in (item for message in interface.messages for item in message.fields):
            if item.type.base in nested:
                need = RosName.parse(item.type.base)
                users.setdefault(registry.owner(need) or need, {}).setdefault(name, item)
    return users
