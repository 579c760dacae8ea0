"""Names and definitions of interfaces for the commands of ``interface``, which need no network."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import KINDS
from rosidl_py_gen.compiler.frontend.missing import missing_package
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry, read_checked, resolve_name
from rosidl_py_gen.compiler.frontend.search_path import scan_search_path
from rosidl_py_gen.errors import TypeNotFoundError
from rosidl_py_gen.ros_cli import CommandError, terminal_output

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.frontend.search_path import SearchPath


def known_names(what: str, paths: Sequence[str] = ()) -> list[str]:
    """Return types or packages, for completion."""
    search = scan_search_path(paths)
    names = names_of(search, "", KINDS)
    if what == "packages":
        return sorted({*search.packages, *(name.package for name in names)})
    return list(map(str, names))


def names_of(search: SearchPath, package: str, kinds: Collection[str]) -> list[RosName]:
    """Return the interfaces of a package, or of all packages. Raises `CommandError` for an unknown package."""
    from rosidl_py_gen.type_loading.from_description import generated_names

    generated = [
        name for name in generated_names() if name.package not in search.packages and package in ("", name.package)
    ]
    if package and package not in search.packages and not generated:
        if package in search.refused:
            raise CommandError(str(search.refused[package]))
        raise CommandError(missing_package(search, package, f"no package {package}"))
    packages = [one for one in search.packages.values() if package in ("", one.name)]
    names = [*(name for one in packages for name in one.files), *generated]
    return sorted(name for name in names if name.kind in kinds)


def name_or_stdin(text: str) -> str:
    """Return the text, or for ``-`` a line of standard input."""
    if text == "-":
        text = sys.stdin.readline().strip() if sys.stdin is not None else ""
        if not text:
            raise CommandError("expected the name of an interface on standard input, found nothing")
    return text


def read_definition(search: SearchPath, text: str) -> tuple[InterfaceRegistry, RosName]:
    """Read a definition from the search path, from a generated package, or from the cache of descriptions."""
    text = name_or_stdin(text)
    name = resolve_name(search, text)
    registry = InterfaceRegistry(search)
    try:
        read_checked(registry, name)
    except TypeNotFoundError:
        from rosidl_py_gen.ros_cli.cached_definitions import cached_registry

        definition = _generated(text) or cached_registry(text)
        if definition is None:
            raise
        return definition
    return registry, name


def _generated(text: str) -> tuple[InterfaceRegistry, RosName] | None:
    from rosidl_py_gen.type_loading.from_description import registry_of_generated_class

    if (definition := registry_of_generated_class(text)) is None:
        return None
    terminal_output.note(definition[2])
    return definition[:2]
