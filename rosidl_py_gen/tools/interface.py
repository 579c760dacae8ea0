"""``interface``: what definitions there are, how they look, their hashes. Needs neither network nor DDS.

Decides how a prototype is quoted: as one word of a shell, which `topic pub` takes as it is.
"""

from __future__ import annotations

import shlex
import sys
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.descriptions import describe
from rosidl_py_gen.compiler.spec.definition import expanded_lines, full_name, read_checked
from rosidl_py_gen.compiler.spec.find import search_path
from rosidl_py_gen.compiler.spec.missing import missing_package
from rosidl_py_gen.compiler.spec.model import ActionDef, ServiceDef
from rosidl_py_gen.compiler.spec.resolve import Library
from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.tools import ToolError, printing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.compiler.spec.find import SearchPath

_KINDS = {"msg": "Messages", "srv": "Services", "action": "Actions"}


def run(command: str, paths: tuple[str, ...], as_json: bool, **arguments: Any) -> int:
    """Returns the exit code."""
    search = search_path(paths)
    match command:
        case "list":
            _list(search, as_json, **arguments)
        case "package":
            _package(search, as_json, **arguments)
        case "packages":
            _packages(search, as_json, **arguments)
        case "show":
            _show(search, as_json, **arguments)
        case "proto":
            _proto(search, paths, as_json, **arguments)
        case "hash":
            _hashes(search, as_json, **arguments)
    return 0


def known_names(what: str, paths: Sequence[str] = ()) -> list[str]:
    """Types or packages, for completion."""
    search = search_path(paths)
    names = _names(search, "", _KINDS)
    return (
        sorted({*search.packages, *(name.package for name in names)}) if what == "packages" else list(map(str, names))
    )


# --------------------------------------------------------------------------------------------------------------- lists


def _chosen(msgs: bool, srvs: bool, actions: bool) -> list[str]:
    chosen = [kind for kind, wanted in zip(_KINDS, (msgs, srvs, actions), strict=True) if wanted]
    return chosen or list(_KINDS)


def _names(search: SearchPath, package: str, kinds: Sequence[str] | dict[str, str]) -> list[RosName]:
    from rosidl_py_gen.types.generated import generated_names

    generated = [
        name for name in generated_names() if name.package not in search.packages and package in ("", name.package)
    ]
    if package and package not in search.packages and not generated:
        if package in search.refused:
            raise ToolError(str(search.refused[package]))
        raise ToolError(missing_package(search, package, f"no package {package}"))
    found = [one for one in search.packages.values() if package in ("", one.name)]
    names = [*(name for one in found for name in one.files), *generated]
    return sorted(name for name in names if name.kind in kinds)


def _list(search: SearchPath, as_json: bool, package: str | None, **kinds: bool) -> None:
    chosen = _chosen(**kinds)
    names = _names(search, package or "", chosen)
    if as_json:
        printing.document([str(name) for name in names])
        return
    for kind in chosen:
        printing.line(f"{_KINDS[kind]}:", "bold")
        printing.lines([f"    {name}" for name in names if name.kind == kind])


def _package(search: SearchPath, as_json: bool, package: str, **kinds: bool) -> None:
    names = [str(name) for name in _names(search, package, _chosen(**kinds))]
    if as_json:
        printing.document(names)
    else:
        printing.lines(names)


def _packages(search: SearchPath, as_json: bool, **kinds: bool) -> None:
    found = sorted({name.package for name in _names(search, "", _chosen(**kinds))})
    if as_json:
        origins = {name: package.origin for name, package in search.packages.items()}
        printing.document([{"name": name, "origin": origins.get(name, "generated")} for name in found])
    else:
        printing.lines(found)


# --------------------------------------------------------------------------------------------------------- definitions


def _given(text: str) -> str:
    if text == "-":
        text = sys.stdin.readline().strip() if sys.stdin is not None else ""
        if not text:
            raise ToolError("expected the name of an interface on standard input, found nothing")
    return text


def _read(search: SearchPath, text: str) -> tuple[Library, RosName]:
    """From the search path, else from a generated package, else from what nodes said of it once."""
    text = _given(text)
    name = full_name(search, text)
    library = Library(search)
    try:
        read_checked(library, name)
    except TypeNotFoundError:
        from rosidl_py_gen.tools.kept import kept_library

        kept = _generated(text) or kept_library(text)
        if kept is None:
            raise
        return kept
    return library, name


def _generated(text: str) -> tuple[Library, RosName] | None:
    from rosidl_py_gen.types.generated import generated_library

    found = generated_library(text)
    if found is None:
        return None
    printing.note(found[2])
    return found[:2]


def _show(search: SearchPath, as_json: bool, name: str, no_comments: bool, all_comments: bool) -> None:
    library, top = _read(search, name)
    if as_json:
        printing.document({"hash": library.type_hash(str(top)), **describe(str(top), library.rows)})
        return
    lines = expanded_lines(library, top, comments=not no_comments, nested_comments=all_comments and not no_comments)
    if not printing.is_terminal():
        printing.block("\n".join(lines))
        return
    for line in lines:
        printing.block(line, "dim" if line.lstrip().startswith("#") else "")


def _hashes(search: SearchPath, as_json: bool, names: tuple[str, ...], parts: bool) -> None:
    found: dict[str, str] = {}
    for text in names:
        library, top = _read(search, text)
        for name in [str(top), *(_parts(library, top) if parts else ())]:
            found[name] = library.type_hash(name)
    if as_json:
        printing.document(found)
    else:
        printing.lines([f"{value}  {name}" for name, value in found.items()])


def _parts(library: Library, top: RosName) -> list[str]:
    interface = library.interface(top)
    match interface:
        case ServiceDef():
            return [str(message.name) for message in interface.messages]
        case ActionDef():
            services = [str(service.name) for service in (interface.send_goal, interface.get_result)]
            return [*(str(message.name) for message in interface.messages), *services]
    return []


# ----------------------------------------------------------------------------------------------------------- prototype


def _proto(search: SearchPath, paths: tuple[str, ...], as_json: bool, name: str, no_quotes: bool) -> None:
    from rosidl_py_gen import to_dict

    values = to_dict(_example(search, _given(name), paths))
    if as_json:
        printing.document(values)
        return
    from rosidl_py_gen.tools.messages import to_yaml

    text = to_yaml(values, flow=None).rstrip("\n")
    printing.block(text if no_quotes else _quoted(text))


def _example(search: SearchPath, text: str, paths: tuple[str, ...]) -> Message:
    """A message with its default values: of a service the request, of an action the goal."""
    from rosidl_py_gen import get_message

    name = full_name(search, text)
    try:
        half = _half(name)
        return get_message(f"{name}_{half}" if half else str(name), path=paths)()
    except TypeNotFoundError:
        from rosidl_py_gen.tools.kept import kept_library
        from rosidl_py_gen.types.by_name import class_of_library

        kept = kept_library(text)
        if kept is None:
            raise
        library, name = kept
        cls: Any = class_of_library(library, name, path=paths)
        made: Message = (getattr(cls, _half(name)) if _half(name) else cls)()
        return made


def _half(name: RosName) -> str:
    """Which part of an interface is filled in; empty for a message."""
    return "" if "_" in name.name else {"msg": "", "srv": "Request", "action": "Goal"}[name.kind]


def _quoted(text: str) -> str:
    """One word of a shell. Double quotes are nearer to the eye; what a shell would look into needs single ones."""
    return shlex.quote(text) if any(char in text for char in '"\\$`!') else f'"{text}"'
