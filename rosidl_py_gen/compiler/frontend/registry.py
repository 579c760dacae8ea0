"""Registry of the interfaces of a search path: parses, selects and checks definitions.

`InterfaceRegistry` parses on demand and never twice. `select` converts the user's filter to interfaces and adds their
dependencies. `check` reports references to types that do not exist, and types that contain themselves.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

from rosidl_py_gen.base.descriptions import Description, FieldRow, TypeDescriptions
from rosidl_py_gen.base.names import RosName, did_you_mean
from rosidl_py_gen.compiler.frontend.bundled import other_distributions_note
from rosidl_py_gen.compiler.frontend.interface_parser import FOREIGN_TYPES, may_be_file, parse_interface, read_source
from rosidl_py_gen.compiler.frontend.model import (
    DERIVED_TYPES_PACKAGES,
    IMPLIED,
    ActionDef,
    Diagnostics,
    FieldDef,
    Interface,
    Location,
    MessageDef,
    ServiceDef,
    nested_types,
)
from rosidl_py_gen.compiler.frontend.size_limits import MAX_LEVELS, SizeChecker
from rosidl_py_gen.errors import DefinitionError, Diagnostic, TypeNotFoundError, display_path

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.frontend.model import SourceText
    from rosidl_py_gen.compiler.frontend.search_path import SearchPath

_COMMON_PACKAGES = ("std_msgs", "builtin_interfaces", "geometry_msgs")
"""Packages whose types are suggested first for unknown types. In ROS 1, types of the first two packages could be
written without package."""
_DERIVED = re.compile(r"_(Request|Response|Event|Goal|Result|Feedback|FeedbackMessage|SendGoal|GetResult)\Z")


class InterfaceRegistry:
    """Collection of interfaces by name, which are parsed on first use, with the diagnostics of the files that were
    read.
    """

    def __init__(self, search: SearchPath) -> None:
        self.search = search
        self.diagnostics = Diagnostics()
        self._interfaces: dict[RosName, Interface | None] = {}
        self._texts: set[RosName] = set()
        self._messages: dict[str, MessageDef] = {}
        self._descriptions = TypeDescriptions(self.field_rows)
        self._missing: set[tuple[str, str]] = set()

    def is_first_report(self, path: str, package: str) -> bool:
        """Return True once for each file and missing package, so that a file reports a missing package only once."""
        is_new = (path, package) not in self._missing
        self._missing.add((path, package))
        return is_new

    def add_text(self, name: RosName, source: SourceText) -> Interface | None:
        """Parse and add an interface whose text is not from the search path; it replaces a file of the same name.

        Returns None, after adding a diagnostic, if the text cannot be used.
        """
        return self.add(name, parse_interface(name, source, self.diagnostics))

    def add(self, name: RosName, interface: Interface | None) -> Interface | None:
        """Add an interface that is not from the search path; it replaces a file of the same name."""
        self._texts.add(name)
        return self._store(name, interface)

    def interface(self, name: RosName) -> Interface | None:
        """Return the interface with a full name.

        Returns None if there is no file for it, or if its file has errors, which are then in `diagnostics`.
        """
        if name not in self._interfaces:
            path = self.search.file(name)
            source = read_source(path, display_path(path), self.diagnostics) if path else None
            if source is not None and not may_be_file(name):
                text = f'"{name.name}" is not an interface name; expected {RosName.NAME_RULE}'
                self.diagnostics.add(Location(source, 1, 1), text)
                source = None
            self._store(name, parse_interface(name, source, self.diagnostics) if source else None)
        return self._interfaces[name]

    def exists(self, name: RosName) -> bool:
        """Return True if an interface of this name has a file or an added text, even with problems."""
        return name in self._texts or self.search.file(name) is not None

    def has_package(self, package: str) -> bool:
        """Return True if any interface of the package has a file or an added text."""
        return package in self.search.packages or any(name.package == package for name in self._texts)

    def message(self, full_name: str) -> MessageDef | None:
        """Return the message with a full name, which may be derived from a service or action (``pkg/srv/X_Request``).

        Returns None if it does not exist.
        """
        if full_name not in self._messages:
            name = RosName.parse(full_name)
            self.interface(name)
            stem = name.name
            while full_name not in self._messages and (cut := _DERIVED.search(stem)):
                stem = stem[: cut.start()]
                self.interface(name._replace(name=stem))
        return self._messages.get(full_name)

    def knows(self, full_name: str) -> bool:
        """Return True if a valid message, service or action has this full name."""
        try:
            tuple(self.field_rows(full_name))
        except TypeNotFoundError:
            return False
        return True

    def owner(self, name: RosName) -> RosName | None:
        """Return the full name of the interface that defines a type: X for a derived type such as ``X_Request``.

        Returns None if no interface defines it.
        """
        stem = name.name
        while not self.exists(name._replace(name=stem)):
            stem, underscore, _ = stem.rpartition("_")
            if not underscore:
                return None
        return name._replace(name=stem)

    def field_rows(self, full_name: str) -> Iterable[FieldRow]:
        """Return the fields of a message, service or action in the form that type descriptions are made from.

        Raises:
            TypeNotFoundError: no interface has this name.
        """
        message = self.message(full_name)
        if message is not None:
            return [(item.name, item.type, item.default_text) for item in message.fields]
        name = RosName.parse(full_name)
        if isinstance(self.interface(name), ActionDef):
            return TypeDescriptions.action_rows(full_name)
        if self.message(f"{full_name}_Request") is None:
            raise TypeNotFoundError(f"no interface {full_name}")
        return TypeDescriptions.service_rows(full_name)

    def type_description(self, full_name: str) -> Description:
        """Return the type description of a message, service or action; all types to which it refers must exist."""
        return self._descriptions.of(full_name)

    def type_hash(self, full_name: str) -> str:
        """Return the RIHS01 hash of a message, service or action; all types to which it refers must exist."""
        return self._descriptions.hash_of(full_name)

    def all_hashes(self, full_name: str) -> dict[str, str]:
        """Return the RIHS01 hashes of a type and of all types that it refers to, by full name."""
        return {name: self.type_hash(name) for name in self.closure(full_name)}

    def closure(self, full_name: str) -> list[str]:
        """Return the full name of a type, followed by the sorted names of all types to which it refers, at
        any depth.
        """
        return [*TypeDescriptions.by_name(self.type_description(full_name))]

    def description_and_constants(self, full_name: str) -> tuple[Description, dict[str, dict[str, str]]]:
        """Return a type's description with default values, and by type name the `repr` of each constant of the type and
        all types in it.
        """
        description = self.type_description(full_name)
        found = {name: self.message(name) for name in TypeDescriptions.by_name(description)}
        return description, {
            name: {item.name: repr(item.value) for item in one.constants} if one else {} for name, one in found.items()
        }

    def nested_types(self, name: RosName) -> list[RosName]:
        """Return the sorted names of the message types in an interface's fields, without the interface's own
        messages.
        """
        interface = self.interface(name)
        return [] if interface is None else sorted(map(RosName.parse, nested_types(interface)))

    def with_dependencies(self, top: RosName) -> list[RosName]:
        """Return a checked interface and all interfaces that it refers to, at any depth.

        Types of `DERIVED_TYPES_PACKAGES` are omitted where a service or an action refers to them, because ROS adds such
        fields to each.
        """
        needed: dict[RosName, None] = {}
        pending = [top]
        while pending:
            name = pending.pop()
            if name in needed:
                continue
            needed[name] = None
            for nested in self.nested_types(name):
                if name.kind == "msg" or nested.package not in DERIVED_TYPES_PACKAGES:
                    pending.append(self.owner(nested) or nested)
        return [*needed]

    def parts(self, name: RosName) -> list[str]:
        """Return the full names of the messages and services that are parts of a service or action; [] for
        a message.
        """
        interface = self.interface(name)
        if not isinstance(interface, ServiceDef | ActionDef):
            return []
        services = (interface.send_goal, interface.get_result) if isinstance(interface, ActionDef) else ()
        return [str(one.name) for one in (*interface.messages, *services)]

    def read_checked(self, name: RosName) -> RosName:
        """Check the interface that defines a type, and return its name: X for a derived type such as ``X_Request``.

        Raises:
            TypeNotFoundError: no interface has this name.
            DefinitionError: the interface or a type that it uses has errors.
        """
        owner = self.owner(name)
        if owner is None:
            raise TypeNotFoundError(self.search.missing_interface(name, f"no interface {name}"))
        check(self, [owner])
        self.raise_diagnostics()
        if not self.knows(str(name)):
            raise TypeNotFoundError(self.search.missing_interface(name, f"no interface {name}"))
        return owner

    def raise_diagnostics(self) -> None:
        """Raise `DefinitionError` with the diagnostics, if there are any."""
        if self.diagnostics.items:
            raise DefinitionError(sorted_diagnostics(self.diagnostics.items))

    def _store(self, name: RosName, interface: Interface | None) -> Interface | None:
        self._interfaces[name] = interface
        if interface is not None:
            for message in interface.messages:
                self._messages[str(message.name)] = message
        return interface


def select(registry: InterfaceRegistry, wanted: list[str]) -> list[RosName]:
    """Return the interfaces that names select, with their dependencies, in name order.

    A package name selects the whole package and the packages that it depends on. A full name selects one interface and
    the interfaces that it depends on. An empty list selects all packages.

    Raises:
        DefinitionError: a name is not on the search path.
    """
    names, problems = select_valid_names(registry, wanted)
    if problems:
        raise DefinitionError(problems)
    return names


def select_valid_names(registry: InterfaceRegistry, wanted: list[str]) -> tuple[list[RosName], list[Diagnostic]]:
    """Return the interfaces that the valid names of a filter select, and diagnostics for the invalid names."""
    search = registry.search
    whole: dict[str, None] = {}
    single: dict[RosName, None] = {}
    problems: list[Diagnostic] = []
    for text in wanted or list(search.packages):
        if "/" in text:
            name = RosName.parse(text, "msg")
            if search.file(name) is None:
                problems.append(Diagnostic(text, 0, 0, search.missing_interface(name, "no interface of this name")))
            else:
                single[name] = None
        elif text in search.packages:
            whole[text] = None
        else:
            refused = search.refused.get(text)
            problems.append(refused or Diagnostic(text, 0, 0, search.missing_package(text, "no package")))
    if not wanted:
        problems += search.refused.values()
    return _transitive_closure(registry, list(whole), list(single)), problems


def _transitive_closure(registry: InterfaceRegistry, packages: list[str], names: list[RosName]) -> list[RosName]:
    closure: set[RosName] = set()
    done: set[str] = set()
    while packages or names:
        if packages:
            package = packages.pop()
            if package in done:
                continue
            done.add(package)
            files = registry.search.packages[package]
            registry.diagnostics.items += files.listing.problems if files.listing else ()
            for name in files.files:
                closure.add(name)
                needed = {need.package for need in registry.nested_types(name)} | set(IMPLIED[name.kind])
                packages += sorted(need for need in needed - done if need in registry.search.packages)
            continue
        name = names.pop()
        if name not in closure and registry.search.file(name) is not None:
            closure.add(name)
            names += registry.nested_types(name)
    return sorted(closure)


def check(registry: InterfaceRegistry, names: Iterable[RosName]) -> None:
    """Add diagnostics for references to unknown types, and for types that contain themselves or are too large."""
    state: dict[str, int] = {}  # depth of the visited types; -1 during the visit
    sizes = SizeChecker(registry.diagnostics)
    for name in names:
        interface = registry.interface(name)
        if interface is not None:
            for message in interface.messages:
                _visit(registry, message, state, sizes)
            sizes.check_interface(interface)


def _visit(
    registry: InterfaceRegistry, message: MessageDef, state: dict[str, int], sizes: SizeChecker, level: int = 1
) -> int:
    """Check a message and the messages that it contains, and return how many levels of types are nested in it."""
    name = str(message.name)
    if name in state:
        return state[name]
    state[name] = -1
    depth = 0
    for item in (one for one in message.fields if one.type.is_message):
        target = registry.message(item.type.base)
        if target is None:
            if not registry.diagnostics.is_full(item.location):
                _report_unknown(registry, message, item)
        elif state.get(item.type.base) == -1:
            registry.diagnostics.add(item.location, f"{item.type.base} contains itself through this field")
        elif item.type.base not in state and level > MAX_LEVELS:
            registry.diagnostics.add(item.location, f"types are nested deeper than {MAX_LEVELS} levels here")
        else:
            depth = max(depth, _visit(registry, target, state, sizes, level + 1) + 1)
    state[name] = depth
    sizes.check(message)
    if depth == MAX_LEVELS:  # types that contain this one would be deeper
        at = Location(message.source, 1, 1)
        registry.diagnostics.add(at, f"{message.name} nests types deeper than {MAX_LEVELS - 1} levels")
    return depth


def _report_unknown(registry: InterfaceRegistry, message: MessageDef, item: FieldDef) -> None:
    name = RosName.parse(item.type.base)
    short = f"{name.package}/{name.name}"
    at = type_location(item)
    if registry.exists(name):
        return  # the file exists, and its problems are reported
    package = registry.search.packages.get(name.package)
    if package is None and registry.has_package(name.package):
        where = ", ".join(registry.search.searched) or "nothing"
        registry.diagnostics.add(at, f'unknown type "{short}" (searched: {where})')
    elif package is None and registry.is_first_report(item.location.source.path, name.package):
        subject = f'unknown package "{name.package}" for {short}'
        is_first = registry.is_first_report("", name.package)
        text = registry.search.missing_package(name.package, subject, str(name)) if is_first else subject
        registry.diagnostics.add(at, text)
    elif package is not None:
        hint = package.not_in_cmake_note(name) or other_distributions_note(name.package, name)
        hint = hint or _other_type(registry, message.name, name)
        registry.diagnostics.add(at, f'unknown type "{short}"{hint}')


def _other_type(registry: InterfaceRegistry, user: RosName, name: RosName) -> str:
    """Return a suggestion for an error about a type that its package lacks; "" if no type is similar.

    The suggestion is never `user`, the message whose field has the unknown type.
    """
    packages = registry.search.packages
    used = [one for one in (_COMMON_PACKAGES + tuple(packages)) if one in packages and one != name.package]
    others = [f"{one}/{name.name}" for one in used if RosName(one, "msg", name.name) in packages[one].files]
    words = [FOREIGN_TYPES[name.name.lower()]] if name.name.lower() in FOREIGN_TYPES else []
    if name.package == user.package and (words or others):  # the field names no package
        return f"; use {' or '.join([*words, *dict.fromkeys(others)][:3])}"
    known = [other.name for other in packages[name.package].files if other.kind == "msg" and other != user]
    hint = did_you_mean(name.name, known).replace('"', f'"{name.package}/', 1)
    return hint or (f"; use {others[0]}" if others else "")


def type_location(item: FieldDef) -> Location:
    """Return the location that diagnostics name for a field's type: column 1 in a .msg file, the field's name in an
    .idl file.
    """
    return item.location if item.location.source.format == "idl" else item.location._replace(column=1)


def sorted_diagnostics(problems: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Return the diagnostics without duplicates, sorted by file, line and column."""
    return sorted(dict.fromkeys(problems), key=lambda problem: (problem.path, problem.line, problem.column))
