"""Names and definitions of interfaces for the commands of ``interface``, which need no network.

Definitions that nodes have described are cached on disk, for types that are not on the search path. The newest
description that contains a whole type is used; else the descriptions of the messages of a service or action are joined,
unless they contradict each other. Files whose hash differs from their name are skipped.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.descriptions import TypeDescriptions
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.compiler.frontend import InterfaceRegistry, SearchPath
from rosidl_py_gen.errors import InvalidNameError, RosidlError, TypeNotFoundError
from rosidl_py_gen.type_loading import CachedDescription, DescribedType

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

    from rosidl_py_gen.base.descriptions import Description


def known_names(kinds: Collection[str], paths: Sequence[str]) -> list[str]:
    """Return the names of all types of `kinds` (msg, srv, action), or of all packages if `kinds` is empty."""
    search = SearchPath.scan(paths)
    names = names_of(search, "", kinds or RosName.KINDS)
    return [*map(str, names)] if kinds else sorted({*search.packages, *(name.package for name in names)})


def names_of(search: SearchPath, package: str, kinds: Collection[str]) -> list[RosName]:
    """Return the sorted interfaces of a package, or of all packages for "".

    Raises `CommandError` if the package is unknown.
    """
    from rosidl_py_gen.type_loading import GeneratedDefinition

    generated = [
        name
        for name in GeneratedDefinition.names()
        if name.package not in search.packages and package in ("", name.package)
    ]
    if package and package not in search.packages and not generated:
        if package in search.refused:
            raise CommandError(str(search.refused[package]))
        raise CommandError(search.missing_package(package, f"no package {package}"))
    packages = [one for one in search.packages.values() if package in ("", one.name)]
    names = [*(name for one in packages for name in one.files), *generated]
    return sorted(name for name in names if name.kind in kinds)


def name_or_stdin(text: str) -> str:
    """Return an argument unchanged, or for ``-`` the first line of standard input.

    Raises `CommandError` if that line is empty.
    """
    if text == "-":
        text = sys.stdin.readline().strip() if sys.stdin is not None else ""
        if not text:
            raise CommandError("expected the name of an interface on standard input, found nothing")
    return text


def read_definition(search: SearchPath, text: str) -> tuple[InterfaceRegistry, RosName]:
    """Return the definition that `text` names, from the search path, a generated package, or cached descriptions."""
    text = name_or_stdin(text)
    name = search.resolve(text)
    registry = InterfaceRegistry(search)
    try:
        registry.read_checked(name)
    except TypeNotFoundError:
        definition = _generated(text)
        if definition is None and (described := find_cached(text)) is not None:
            definition = described.registry(), described.name
        if definition is None:
            raise
        return definition
    return registry, name


def _generated(text: str) -> tuple[InterfaceRegistry, RosName] | None:
    from rosidl_py_gen.type_loading import GeneratedDefinition

    if (definition := GeneratedDefinition.find(text)) is None:
        return None
    terminal_output.note(definition.note)
    return definition.registry, definition.name


class _CachedDescriptions(NamedTuple):
    individuals: dict[str, Description]
    sources: dict[str, tuple[str, str]]

    def describe(self, name: RosName) -> DescribedType:
        is_service = name.kind == "srv" and "_" not in name.name
        return DescribedType(str(name), self.individuals, self.sources, is_service=is_service)


def find_cached(text: str) -> DescribedType | None:
    """Return a definition that a node once described and that is cached on disk; None if there is none.

    The type is ``pkg/kind/Name``, or ``pkg/Name`` of any kind. A note on standard error names the hash of the
    definition, and other cached definitions of the same name.

    Raises:
        CommandError: the cached messages of a service or an action contradict each other.
    """
    for name in _names(text):
        descriptions = list(_descriptions(name))
        if found := _by_hash(name, descriptions) or _joined(name, descriptions):
            (type_hash, described), others = next(iter(found.items())), list(found)[1:]
            more = f"; other cached definitions: {', '.join(others)}" if others else ""
            terminal_output.note(f"{name} is not on the search path; using the cached definition {type_hash}{more}")
            return described
    return None


def _names(text: str) -> Iterator[RosName]:
    for kind in RosName.KINDS if text.count("/") == 1 else ("msg",) if "/" in text else ():
        with suppress(InvalidNameError):
            yield RosName.parse(text, kind)


def _descriptions(name: RosName) -> Iterator[_CachedDescriptions]:
    """Yield the valid cached type descriptions that mention a type, the newest first."""
    from rosidl_py_gen import to_dict
    from rosidl_py_gen.msgs.type_description_interfaces.srv import GetTypeDescription_Response

    for type_hash, data in CachedDescription.find(containing=str(name).encode()):
        try:
            response = GetTypeDescription_Response.decode(data)
            description = to_dict(response.type_description)
            if TypeDescriptions.rihs01(description) != type_hash:
                continue
        except (RosidlError, ValueError, LookupError):
            continue
        sources = {one.type_name: (one.encoding, one.raw_file_contents) for one in response.type_sources}
        yield _CachedDescriptions(TypeDescriptions.by_name(description), sources)


def _by_hash(name: RosName, descriptions: list[_CachedDescriptions]) -> dict[str, DescribedType]:
    """Return the definitions of a type in cached descriptions that contain the type completely, by hash."""
    found: dict[str, DescribedType] = {}
    for one in descriptions:
        described = one.describe(name)
        if described.is_complete:
            with suppress(RosidlError):  # invalid, or too large
                found.setdefault(described.registry().type_hash(str(name)), described)
    return found


def _joined(name: RosName, descriptions: list[_CachedDescriptions]) -> dict[str, DescribedType]:
    """Return a service or action whose messages are described in several cached descriptions, by its hash.

    Returns {} if a message is missing.
    """
    joined = _CachedDescriptions({}, {})
    messages = joined.describe(name).messages
    for one in descriptions if len(messages) > 1 else ():
        if one.individuals.keys().isdisjoint(messages):
            continue
        for message, description in one.individuals.items():
            if joined.individuals.setdefault(message, description) != description:
                raise CommandError(
                    f"{name} is not on the search path, and its cached messages have several definitions of {message}; "
                    "pass --path"
                )
        for message, source in one.sources.items():
            joined.sources.setdefault(message, source)
    return _by_hash(name, [joined])
