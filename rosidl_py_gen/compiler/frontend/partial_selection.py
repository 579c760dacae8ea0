"""What of a selection can still be generated when some of it is wrong.

An interface is left out when its own file has problems, or when it needs one that is left out; the latter gets a
problem of its own that names the cause.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.compiler.frontend.model import messages_of
from rosidl_py_gen.compiler.frontend.registry import type_location
from rosidl_py_gen.errors import Diagnostic, display_path

if TYPE_CHECKING:
    from collections.abc import Container

    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.frontend.model import FieldDef
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry


def skip_strays(registry: InterfaceRegistry, names: list[RosName], wanted: Container[str]) -> list[RosName]:
    """Drop files that do not compile and that no other file refers to, where no list says which files count.

    Their diagnostics become notes of their package. A package of such files only keeps them all.

    Args:
        registry: contains the diagnostics of `check` over the names.
        names: a selection that has all its dependencies.
        wanted: full names that must not be dropped.

    Returns:
        The remaining names.
    """
    packages = registry.search.packages
    listings = {package: packages[package].listing for package in {name.package for name in names}}
    diagnostics = {problem.path: problem for problem in reversed(registry.diagnostics.items)}
    strays = {
        name: diagnostics[path]
        for name in _with_problems(registry, names)
        if (listing := listings[name.package]) and not listing.complete and str(name) not in wanted
        if (path := display_path(packages[name.package].files[name])) in diagnostics
    }
    users: dict[RosName, set[RosName]] = {}
    for name in names if strays else ():
        for item in _references(registry, name):
            need = split_ros_name(item.type.base)
            users.setdefault(registry.owner(need) or need, set()).add(name)
    dropped: dict[RosName, Diagnostic] = {}
    waiting = list(strays)
    for name in waiting:  # grows inside the loop
        if name in strays and name not in dropped and users.get(name, set()) <= {name, *dropped}:
            dropped[name] = strays[name]
            waiting += [need for need, found in users.items() if name in found]
    rest = {name.package for name in names if name not in dropped}
    for name, problem in dropped.items():
        listing = listings[name.package]
        if name.package in rest and listing is not None:
            note = replace(problem, text=f"skipped, as no other file refers to it: {problem.text}")
            listing.notes += [note] if note not in listing.notes else []
            registry.diagnostics.items = [one for one in registry.diagnostics.items if one.path != problem.path]
    return [name for name in names if name not in dropped or name.package not in rest]


def split_valid(registry: InterfaceRegistry, names: list[RosName]) -> tuple[list[RosName], list[Diagnostic]]:
    """Tell the right interfaces from the wrong ones.

    Args:
        registry: its diagnostics say what is wrong; `check` has been over the names.
        names: a selection that has all it depends on.

    Returns:
        The interfaces that can be generated, in the order given, and a problem for each that cannot only because of
        another one.
    """
    wrong = _with_problems(registry, names)
    if not wrong:
        return names, []
    causes = {name: name for name in wrong}  # what is left out -> what is wrong in the first place
    users: dict[RosName, list[tuple[RosName, FieldDef]]] = {}
    for name in names:
        for item in _references(registry, name):
            need = split_ros_name(item.type.base)
            users.setdefault(registry.owner(need) or need, []).append((name, item))
    problems: list[Diagnostic] = []
    waiting = list(wrong)
    for gone in waiting:  # grows while it is gone through
        for user, item in users.get(gone, ()):
            if user not in causes:
                causes[user] = causes[gone]
                text = f"{user} needs {causes[gone]}, which has problems"
                problems.append(type_location(item).diagnostic(text))
                waiting.append(user)
    return [name for name in names if name not in causes], problems


def _with_problems(registry: InterfaceRegistry, names: list[RosName]) -> list[RosName]:
    paths = {problem.path for problem in registry.diagnostics.items}
    files = ((name, registry.search.file(name)) for name in names)
    return [name for name, file in files if registry.interface(name) is None or (file and display_path(file) in paths)]


def _references(registry: InterfaceRegistry, name: RosName) -> list[FieldDef]:
    interface = registry.interface(name)
    if interface is None:
        return []
    own = {str(message.name) for message in messages_of(interface)}
    fields = (item for message in messages_of(interface) for item in message.fields)
    return [item for item in fields if item.type.is_message and item.type.base not in own]
