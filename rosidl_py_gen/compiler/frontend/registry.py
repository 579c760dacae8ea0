"""From a search path and a selection to a checked set of interfaces: parsed, complete, free of cycles.

`InterfaceRegistry` parses on demand and never twice. `select` turns the user's filter into packages and interfaces
and adds the dependency closure; `check` finds references to types that do not exist and types that contain themselves.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

from rosidl_py_gen.base.descriptions import (
    Description,
    FieldRow,
    TypeHasher,
    action_rows,
    build_type_description,
    default_text,
    service_rows,
)
from rosidl_py_gen.base.names import INTERFACE_RULE, RosName, did_you_mean, split_ros_name
from rosidl_py_gen.compiler.frontend.derived_interfaces import IMPLIED
from rosidl_py_gen.compiler.frontend.interface_parser import may_be_file, parse_interface, read_source
from rosidl_py_gen.compiler.frontend.missing import missing_interface, missing_package
from rosidl_py_gen.compiler.frontend.model import (
    ActionDef,
    Diagnostics,
    FieldDef,
    Interface,
    Location,
    MessageDef,
    messages_of,
)
from rosidl_py_gen.compiler.frontend.msg_parser import FOREIGN_TYPES
from rosidl_py_gen.compiler.frontend.size_limits import MAX_LEVELS, SizeChecker
from rosidl_py_gen.errors import DefinitionError, Diagnostic, TypeNotFoundError, display_path

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.frontend.model import SourceText
    from rosidl_py_gen.compiler.frontend.search_path import SearchPath

_COMMON_PACKAGES = ("std_msgs", "builtin_interfaces", "geometry_msgs")
"""Packages that are suggested before others: ROS 1 has types of the first two without a package."""
_DERIVED = re.compile(r"_(Request|Response|Event|Goal|Result|Feedback|FeedbackMessage|SendGoal|GetResult)\Z")


class InterfaceRegistry:
    """Interfaces by name, parsed when first asked for.

    Attributes:
        diagnostics: what was wrong with the files read so far.
    """

    def __init__(self, search: SearchPath) -> None:
        self.search = search
        self.diagnostics = Diagnostics()
        self._interfaces: dict[RosName, Interface | None] = {}
        self._texts: set[RosName] = set()
        self._messages: dict[str, MessageDef] = {}
        self._hashes = TypeHasher(self.field_rows)
        self._missing: set[tuple[str, str]] = set()

    def is_new_missing(self, path: str, package: str) -> bool:
        """Return True for the first call with a file and a package that is missing; a file reports each once."""
        is_new = (path, package) not in self._missing
        self._missing.add((path, package))
        return is_new

    def add_text(self, name: RosName, source: SourceText) -> Interface | None:
        """Parse text that comes from no file of the search path; it hides a file of the same name."""
        return self.add(name, parse_interface(name, source, self.diagnostics))

    def add(self, name: RosName, interface: Interface | None) -> Interface | None:
        """Take in what comes from no file of the search path; it hides a file of the same name."""
        self._texts.add(name)
        return self._keep(name, interface)

    def interface(self, name: RosName) -> Interface | None:
        """The interface of this name; None when there is no file, or it has problems (see `diagnostics`)."""
        if name not in self._interfaces:
            path = self.search.file(name)
            source = read_source(path, display_path(path), self.diagnostics) if path else None
            if source is not None and not may_be_file(name):
                text = f'"{name.name}" is not an interface name; expected {INTERFACE_RULE}'
                self.diagnostics.add(Location(source, 1, 1), text)
                source = None
            self._keep(name, parse_interface(name, source, self.diagnostics) if source else None)
        return self._interfaces[name]

    def exists(self, name: RosName) -> bool:
        """Whether there is a file or text of this name, however broken."""
        return name in self._texts or self.search.file(name) is not None

    def has_package(self, package: str) -> bool:
        """Whether any interface of the package is known, from files or texts."""
        return package in self.search.packages or any(name.package == package for name in self._texts)

    def message(self, full_name: str) -> MessageDef | None:
        """A message by full name, derived ones (``pkg/srv/X_Request``) included."""
        if full_name not in self._messages:
            name = split_ros_name(full_name)
            self.interface(name)
            stem = name.name
            while full_name not in self._messages and (cut := _DERIVED.search(stem)):
                stem = stem[: cut.start()]
                self.interface(name._replace(name=stem))
        return self._messages.get(full_name)

    def knows(self, full_name: str) -> bool:
        """Whether a message, service or action of this name came out of what was read."""
        try:
            tuple(self.field_rows(full_name))
        except TypeNotFoundError:
            return False
        return True

    def owner(self, name: RosName) -> RosName | None:
        """The interface a name belongs to: itself, or for ``X_Request`` and the like X; None when there is none."""
        stem = name.name
        while not self.exists(name._replace(name=stem)):
            stem, underscore, _ = stem.rpartition("_")
            if not underscore:
                return None
        return name._replace(name=stem)

    def field_rows(self, full_name: str) -> Iterable[FieldRow]:
        """The fields of any type, services and actions included, for a type description."""
        message = self.message(full_name)
        if message is not None:
            return [(item.name, item.type, default_text(item.default)) for item in message.fields]
        name = split_ros_name(full_name)
        if isinstance(self.interface(name), ActionDef):
            return action_rows(full_name)
        if self.message(f"{full_name}_Request") is None:
            raise TypeNotFoundError(f"no interface {full_name}")
        return service_rows(full_name)

    def type_hash(self, full_name: str) -> str:
        """RIHS01 of a message, service or action whose references all exist."""
        return self._hashes.of(full_name)

    def all_hashes(self, full_name: str) -> dict[str, str]:
        """RIHS01 of a type and of every type it refers to, by name."""
        description = build_type_description(full_name, self.field_rows)
        names = [full_name, *(one["type_name"] for one in description["referenced_type_descriptions"])]
        return {name: self.type_hash(name) for name in names}

    def constants(self, full_name: str) -> dict[str, str]:
        """The constants of a message as name -> repr of the Python value; empty for services and actions."""
        message = self.message(full_name)
        return {item.name: repr(item.value) for item in message.constants} if message else {}

    def fingerprint(self, full_name: str) -> tuple[Description, dict[str, dict[str, str]]]:
        """All that a class of the type depends on: its full description with defaults, and all constants by type."""
        description = build_type_description(full_name, self.field_rows)
        names = [full_name, *(one["type_name"] for one in description["referenced_type_descriptions"])]
        return description, {name: self.constants(name) for name in names}

    def _keep(self, name: RosName, interface: Interface | None) -> Interface | None:
        self._interfaces[name] = interface
        if interface is not None:
            for message in messages_of(interface):
                self._messages[str(message.name)] = message
        return interface


def split_filter(text: str) -> list[str]:
    """``a:b;c`` -> the names in it; both separators count, blanks and empty parts do not."""
    return [part.strip() for part in re.split("[:;,]", text) if part.strip()]


def select(registry: InterfaceRegistry, wanted: list[str]) -> list[RosName]:
    """The interfaces to generate: what the filter names, with its dependencies, in name order.

    A package name selects the package and the packages it depends on, whole. A full name selects one interface and the
    interfaces it needs. An empty filter selects every package found.

    Raises:
        DefinitionError: a name in the filter stands for nothing.
    """
    names, problems = select_valid_names(registry, wanted)
    if problems:
        raise DefinitionError(problems)
    return names


def select_valid_names(registry: InterfaceRegistry, wanted: list[str]) -> tuple[list[RosName], list[Diagnostic]]:
    """What `select` gives, with the problems of the filter beside what the rest of it stands for."""
    search = registry.search
    whole: dict[str, None] = {}
    single: dict[RosName, None] = {}
    problems: list[Diagnostic] = []
    for text in wanted or list(search.packages):
        if "/" in text:
            name = split_ros_name(text, "msg")
            if search.file(name) is None:
                problems.append(Diagnostic(text, 0, 0, missing_interface(search, name, "no interface of this name")))
            else:
                single[name] = None
        elif text in search.packages:
            whole[text] = None
        else:
            refused = search.refused.get(text)
            problems.append(refused or Diagnostic(text, 0, 0, missing_package(search, text, "no package")))
    if not wanted:
        problems += search.refused.values()
    return _transitive_closure(registry, list(whole), list(single)), problems


def _transitive_closure(registry: InterfaceRegistry, packages: list[str], names: list[RosName]) -> list[RosName]:
    taken: dict[RosName, None] = {}
    done: set[str] = set()
    while packages or names:
        if packages:
            package = packages.pop()
            if package in done:
                continue
            done.add(package)
            found = registry.search.packages[package]
            registry.diagnostics.items += found.listing.problems if found.listing else ()
            for name in found.files:
                taken[name] = None
                needed = {need.package for need in _dependencies(registry, name)} | set(IMPLIED[name.kind])
                packages += sorted(need for need in needed - done if need in registry.search.packages)
            continue
        name = names.pop()
        if name not in taken and registry.search.file(name) is not None:
            taken[name] = None
            names += _dependencies(registry, name)
    return sorted(taken)


def _dependencies(registry: InterfaceRegistry, name: RosName) -> list[RosName]:
    interface = registry.interface(name)
    if interface is None:
        return []
    own = {str(message.name) for message in messages_of(interface)}
    bases = {item.type.base for message in messages_of(interface) for item in message.fields if item.type.is_message}
    return sorted(split_ros_name(base) for base in bases - own)


def check(registry: InterfaceRegistry, names: Iterable[RosName]) -> None:
    """Add a finding for every reference to a type that does not exist, and for every type that contains itself or is
    too large.
    """
    state: dict[str, int] = {}  # depth of what is done; -1 while it is being visited
    measures = SizeChecker(registry.diagnostics)
    for name in names:
        interface = registry.interface(name)
        if interface is not None:
            for message in messages_of(interface):
                _visit(registry, message, state, measures)


def _visit(registry: InterfaceRegistry, top: MessageDef, state: dict[str, int], measures: SizeChecker) -> None:
    if str(top.name) in state:
        return
    stack = [(top, iter(top.fields), [0])]
    state[str(top.name)] = -1
    while stack:
        message, fields, depth = stack[-1]
        item = next((one for one in fields if one.type.is_message), None)
        if item is None:
            stack.pop()
            state[str(message.name)] = depth[0]
            measures.check(message)
            if depth[0] == MAX_LEVELS:  # whatever contains this one would be deeper
                at = Location(message.source, 1, 1)
                registry.diagnostics.add(at, f"{message.name} nests types deeper than {MAX_LEVELS - 1} levels")
            if stack:
                stack[-1][2][0] = max(stack[-1][2][0], depth[0] + 1)
            continue
        target = registry.message(item.type.base)
        if target is None and not registry.diagnostics.is_full(item.location):
            _report_unknown(registry, message, item)
        elif target is None:
            continue
        elif state.get(item.type.base) == -1:
            registry.diagnostics.add(item.location, f"{item.type.base} contains itself through this field")
        elif item.type.base in state:
            depth[0] = max(depth[0], state[item.type.base] + 1)
        elif len(stack) > MAX_LEVELS:
            registry.diagnostics.add(item.location, f"types are nested deeper than {MAX_LEVELS} levels here")
        else:
            state[item.type.base] = -1
            stack.append((target, iter(target.fields), [0]))


def _report_unknown(registry: InterfaceRegistry, message: MessageDef, item: FieldDef) -> None:
    name = split_ros_name(item.type.base)
    short = f"{name.package}/{name.name}"
    at = type_location(item)
    if registry.exists(name):
        return  # the file is there and has problems of its own, reported there
    package = registry.search.packages.get(name.package)
    if package is None and registry.has_package(name.package):
        where = ", ".join(registry.search.searched) or "nothing"
        registry.diagnostics.add(at, f'unknown type "{short}" (searched: {where})')
    elif package is None and registry.is_new_missing(item.location.source.path, name.package):
        subject = f'unknown package "{name.package}" for {short}'
        is_first = registry.is_new_missing("", name.package)
        text = missing_package(registry.search, name.package, subject, str(name)) if is_first else subject
        registry.diagnostics.add(at, text)
    elif package is not None:
        hint = package.not_in_cmake_note(name) or _other_type(registry, message.name, name)
        registry.diagnostics.add(at, f'unknown type "{short}"{hint}')


def _other_type(registry: InterfaceRegistry, user: RosName, name: RosName) -> str:
    """Return what may be meant by a type that its package lacks; never the message that has the field."""
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
    """Where a field names its type: in a .msg in column 1; an .idl member is located by its name."""
    return item.location if item.location.source.format == "idl" else item.location._replace(column=1)


def raise_diagnostics(registry: InterfaceRegistry) -> None:
    """Raise what was found, in file and line order.

    Raises:
        DefinitionError: when there is anything.
    """
    if registry.diagnostics.items:
        raise DefinitionError(sorted_diagnostics(registry.diagnostics.items))


def sorted_diagnostics(problems: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Each problem once, in file and line order."""
    return sorted(dict.fromkeys(problems), key=lambda problem: (problem.path, problem.line, problem.column))
